"""All-pairs distances in half a megabyte: 8 bits each, the lower triangle, each entry told by how it differs from its
neighbours.

With points in the order of a space-filling curve, rows and columns change slowly. Entry (i, j), j < i, is stored as
`D[i, j] - D[i, j-1] - D[i-1, j] + D[i-1, j-1]` modulo 256 (the gradient predictor of lossless image coding; entries
left of column 0 and above row 0 count as 0), which zlib then shrinks about fourfold. Decoding is exact; only the 8 bits
are not.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from b23d.stages.workbench.pictures.packing import pack

LEVELS = 255
BITS = 10  # of each coordinate on the curve: far finer than candidates are apart


def pack_distances(distances: np.ndarray, points: np.ndarray) -> dict[str, Any]:
    """`{"order", "largest", "residuals"}` of symmetric distances (n, n) between points (n, 3), n < 65,536.

    A step of the stored values is `largest / 255`; pairs that no path joins count as the largest finite distance.
    """
    order = curve_order(points)
    levels, largest = quantise(distances)
    residuals = encode(levels[np.ix_(order, order)])
    return {"order": pack(order.astype(np.uint16)), "largest": largest, "residuals": pack(residuals)}


def quantise(distances: np.ndarray) -> tuple[np.ndarray, float]:
    """(n, n) uint8 levels with 255 for the largest finite distance, and that distance."""
    values = distances.astype(np.float32)
    finite = np.isfinite(values)
    largest = float(values[finite].max(initial=0.0))
    values[~finite] = largest
    return np.round(values * (LEVELS / (largest or 1.0))).astype(np.uint8), largest


def encode(levels: np.ndarray) -> np.ndarray:
    """(n (n-1) / 2,) uint8 residuals of the strictly lower triangle of symmetric (n, n) uint8 with zero diagonal, row
    by row."""
    wide = levels.astype(np.int16)
    residuals = np.diff(np.diff(wide, axis=1, prepend=0), axis=0, prepend=0)
    return residuals[np.tri(len(levels), k=-1, dtype=bool)].astype(np.uint8)  # wraps: modulo 256


def decode(residuals: np.ndarray, n: int) -> np.ndarray:
    """The inverse of `encode`, as the page does it; for tests."""
    levels = np.zeros((n, n), np.uint8)
    at = 0
    for i in range(1, n):
        row = residuals[at : at + i].astype(np.int64)
        at += i
        levels[i, :i] = np.mod(np.cumsum(row + np.diff(levels[i - 1, :i].astype(np.int64), prepend=0)), 256)
    return np.maximum(levels, levels.T)


def curve_order(points: np.ndarray) -> np.ndarray:
    """Indices (n,) of points (n, 3) along a Morton (z-order) curve through their bounding cube."""
    low, side = points.min(axis=0), float(np.ptp(points, axis=0).max()) or 1.0
    cells = ((points - low) / side * (2**BITS - 1)).astype(np.uint64)
    key = np.zeros(len(points), np.uint64)
    for bit in range(BITS):
        for axis in range(3):
            key |= ((cells[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(key, kind="stable")
