"""Left and right: what a mirror changes in how features run over a surface.

Features see no difference between a left and a right hand. But go over a surface towards where one feature grows, and
another grows to your left or to your right: that changes in a mirror (the orientation that Ren et al., Continuous and
orientation-preserving correspondences via functional maps, 2018, keep).
"""

from __future__ import annotations

from itertools import combinations

import numpy as np

from b23d.stages.correspondence.surfaces import FeaturedSurface, centred

COMPONENTS = 5
"""Principal components of both shapes' features whose pairs are compared."""
GRADIENT, SMOOTHING, DEPTH = 0.05, 0.05, 0.04
"""Standard deviations, in longest sides, of the neighbourhoods of gradients, of the results, and of the neighbourhood
in space whose middle lies inside the surface."""


def side_channels(first: FeaturedSurface, second: FeaturedSurface) -> tuple[np.ndarray, np.ndarray]:
    """(n, pair) and (m, pair) float32: for each pair of feature components, how far the second grows to the left of
    where the first grows, seen from inside. A shape's mirror image has them negated; turned, they stay. The mean square
    of the first shape's, summed over pairs, is 1."""
    looks = centred(first.features), centred(second.features)
    basis = np.linalg.svd(np.concatenate(looks), full_matrices=False)[2][:COMPONENTS].T
    own, theirs = (_sides(shape, look @ basis) for shape, look in zip((first, second), looks, strict=True))
    scale = np.sqrt((own**2).sum(axis=1).mean()) or 1.0
    return (own / scale).astype(np.float32), (theirs / scale).astype(np.float32)


def _sides(shape: FeaturedSurface, values: np.ndarray) -> np.ndarray:
    """(n, pair) of values (n, c)."""
    reach, points = shape.reach(), shape.points.astype(np.float64)
    near = _weights(reach, GRADIENT)
    gradients = _gradients(near, points, near @ values)
    inward = _weights(_apart(points), DEPTH) @ points - points
    inward /= np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), 1e-9)
    steep = np.maximum(np.sqrt((gradients**2).sum(axis=2).mean(axis=0)), 1e-9)
    pairs = list(combinations(range(values.shape[1]), 2))
    found = np.stack(
        [
            (np.cross(gradients[:, a], gradients[:, b]) * inward).sum(axis=1) / (steep[a] * steep[b])
            for a, b in pairs
        ],
        axis=1,
    ) if pairs else np.zeros((len(points), 0))  # fmt: skip
    smoothed: np.ndarray = _weights(reach, SMOOTHING) @ found
    return smoothed


def _gradients(near: np.ndarray, points: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(n, c, 3) in space, by least squares over neighbourhoods weighed by near (n, n), whose rows sum to 1."""
    middle, mean = near @ points, near @ values
    spread = (near @ (points[:, :, None] * points[:, None]).reshape(len(points), 9)).reshape(-1, 3, 3)
    spread -= middle[:, :, None] * middle[:, None]
    spread += 1e-4 * GRADIENT**2 * np.eye(3)  # a flat neighbourhood has no gradient across
    shared = near @ (values[:, :, None] * points[:, None]).reshape(len(points), -1)
    shared = shared.reshape(len(points), values.shape[1], 3) - mean[:, :, None] * middle[:, None]
    found: np.ndarray = np.linalg.solve(spread, shared.transpose(0, 2, 1)).transpose(0, 2, 1)
    return found


def _weights(distances: np.ndarray, sd: float) -> np.ndarray:
    """(n, n) float64, rows summing to 1."""
    found = np.exp(-0.5 * (distances.astype(np.float64) / sd) ** 2)
    normalised: np.ndarray = found / found.sum(axis=1, keepdims=True)
    return normalised


def _apart(points: np.ndarray) -> np.ndarray:
    from scipy.spatial.distance import cdist

    found: np.ndarray = cdist(points, points)
    return found
