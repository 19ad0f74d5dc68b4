"""All-pairs distances in 30 kB: those between landmarks, 8 bits each, and how other points lie among them.

With landmarks in the order of a space-filling curve, rows and columns change slowly. Entry (i, j), j < i, is stored as
`D[i, j] - D[i, j-1] - D[i-1, j] + D[i-1, j-1]` modulo 256 (the gradient predictor of lossless image coding; entries
left of column 0 and above row 0 count as 0), which zlib then shrinks about fourfold. The page takes a distance between
two points as the mean over those of their landmarks, by weight: no farther off than the landmarks are from the points.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from b23d.stages.workbench.pictures.packing import curve_order, pack

LANDMARKS = 256
NEAR = 3  # landmarks that a point lies among
LEVELS = 255
FAR = 1e6  # in the place of infinite, so that a point which no path joins to any landmark has weights, too


def pack_distances(distances: np.ndarray, points: np.ndarray) -> dict[str, Any]:
    """Symmetric distances (n, n) between points (n, 3), for `static/details.js`.

    `residuals` are steps of `largest` / 255; `near` are the (n, 3) landmarks of every point, `weights` theirs, sum 255.

    Pairs that no path joins count as the largest finite distance.
    """
    chosen = landmarks(points)
    levels, largest = quantise(distances[np.ix_(chosen, chosen)])
    near, weights = among(distances[:, chosen])
    return {
        "landmarks": len(chosen),
        "largest": largest,
        "residuals": pack(encode(levels)),
        "near": pack(near),
        "weights": pack(weights),
    }


def landmarks(points: np.ndarray) -> np.ndarray:
    """(m,) indices of at most 256 farthest-point samples of (n, 3), along a curve."""
    from b23d.stages.geometry.sampling import farthest_points

    chosen = np.sort(farthest_points(points, LANDMARKS))
    return np.asarray(chosen[curve_order(points[chosen])])


def among(distances: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each point's nearest landmarks (n, 3) uint16, nearest first, and their weights (n, 3) uint8, the inverse of the
    distance; distances: (n, m) from points to landmarks."""
    away = np.nan_to_num(distances.astype(np.float32), posinf=FAR)
    count = min(NEAR, away.shape[1])
    near = np.argsort(away, axis=1, kind="stable")[:, :count]
    closest = np.take_along_axis(away, near, axis=1)
    nearness = 1 / np.maximum(closest, 1e-6)
    weights = np.floor(LEVELS * nearness / nearness.sum(axis=1, keepdims=True)).astype(np.uint8)
    weights[:, 0] += (LEVELS - weights.astype(int).sum(axis=1)).astype(np.uint8)
    rest = NEAR - count
    return np.pad(near, ((0, 0), (0, rest))).astype(np.uint16), np.pad(weights, ((0, 0), (0, rest)))


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
