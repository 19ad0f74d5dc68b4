"""Which patches of a view an encoder is given, and which of them stands for those that it is not."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation, distance_transform_edt

STEP = 8
"""Patches of a view come in multiples of this, so that views of equal length go through together without padding."""
APART = 1e4
"""Between views, in patches: farther than any two patches of one view."""


def foreground_patches(face_ids: np.ndarray, grid: tuple[int, int]) -> np.ndarray:
    """(view, i, j) bool: patches with any pixel of `face_ids` (view, row, column) that shows the shape, ids ≥ 0.

    A view that shows nothing has all of its patches.
    """
    shown = face_ids >= 0
    for axis, count in enumerate(grid, start=1):
        pixels = shown.shape[axis]
        edges = np.arange(count + 1) * pixels / count
        before = np.zeros_like(shown, np.int32, shape=[n + (k == axis) for k, n in enumerate(shown.shape)])
        np.cumsum(shown, axis=axis, out=before[(slice(None),) * axis + (slice(1, None),)])
        first, last = np.floor(edges[:-1]).astype(int), np.ceil(edges[1:]).astype(int)
        shown = before.take(last, axis=axis) > before.take(first, axis=axis)
    shown[~shown.any(axis=(1, 2))] = True
    return shown


def with_background(foreground: np.ndarray, background: int, seed: int) -> np.ndarray:
    """(view, i, j) bool: the foreground and at least `background` random other patches of each view, up to a multiple
    of eight in all; every patch where there are no more."""
    views = len(foreground)
    chosen = foreground.reshape(views, -1)
    wanted = -(-(chosen.sum(axis=1) + background) // STEP) * STEP
    order = np.random.default_rng(seed).random(chosen.shape)
    order[chosen] = -1
    rank = order.argsort(axis=1).argsort(axis=1)
    return (rank < wanted[:, None]).reshape(foreground.shape)


def with_ring(foreground: np.ndarray) -> np.ndarray:
    """(view, i, j) bool: the foreground and the eight patches around each of its patches, which is as far as bilinear
    sampling reaches."""
    return binary_dilation(foreground, np.ones((1, 3, 3), bool))


def nearest_kept(kept: np.ndarray) -> np.ndarray:
    """(view, i, j) int32: for every patch the row, among the kept ones in the order of `np.nonzero(kept)`, of the
    nearest kept patch of its view; itself where it is kept. At least one of each view must be."""
    rows = np.cumsum(kept.ravel(), dtype=np.int32).reshape(kept.shape) - 1
    view, i, j = distance_transform_edt(~kept, sampling=(APART, 1, 1), return_distances=False, return_indices=True)
    nearest: np.ndarray = rows[view, i, j]
    return nearest
