"""Triangle strips and fans, as PLY and glTF have them, as triangles."""

from __future__ import annotations

import numpy as np


def strip_triangles(index: np.ndarray) -> np.ndarray:
    """Strips one after another, each ended by -1, as triangles (t, 3) int64 that all turn as the first of their
    strip."""
    ends = index < 0
    begin = np.maximum.accumulate(np.where(np.concatenate([[True], ends[:-1]]), np.arange(len(index)), 0))
    first = np.flatnonzero(~(ends[:-2] | ends[1:-1] | ends[2:])) if len(index) > 2 else np.zeros(0, np.int64)
    odd = (first - begin[first]) % 2
    return np.stack([index[first], index[first + 1 + odd], index[first + 2 - odd]], axis=1).astype(np.int64)


def fan_triangles(index: np.ndarray) -> np.ndarray:
    """One fan around its first corner as triangles (t, 3) int64."""
    if len(index) < 3:
        return np.zeros((0, 3), np.int64)
    return np.stack([np.full(len(index) - 2, index[0]), index[1:-1], index[2:]], axis=1).astype(np.int64)
