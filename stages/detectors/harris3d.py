"""HARRIS-3D (Sipiran & Bustos 2011, The Visual Computer 27): the Harris response of a quadratic patch fitted around
each point.

The paper's rings of a mesh's vertices become a ball here, so that clouds work, too; lengths in the patch are in units
of its radius, so that responses compare between scales.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from b23d.stages.geometry.sampling import farthest_points

ENOUGH = 48
"""Points that describe a ball: where balls hold more on average, they are filled from an evenly thinned cloud."""
MOST = 2 * ENOUGH
"""Of a ball that still has more, the nearest."""
FEWEST = 7
"""A quadratic patch has six coefficients."""


def harris3d(points: np.ndarray, radius: float, k: float) -> npt.NDArray[np.float64]:
    """Response h = det E - k tr² E (n,), with E the Gaussian mean of ∇z ∇zᵀ over the patch (the paper's closed form, σ²
    = 2).

    Patch: the plane of the ball's principal axes through the point, and on it z = p1 x²/2 + p2 xy + p3 y²/2 + p4 x + p5
    y + p6 by least squares. h is above 0 where the normal turns in both directions, below along an edge, 0 on a plane
    and where a ball has too few points. points: (n, 3) float64.
    """
    offsets, inside = _balls(points, radius)
    count = inside.sum(axis=1)
    mean = offsets.sum(axis=1) / np.maximum(count, 1)[:, None]
    square = offsets.transpose(0, 2, 1) @ offsets / np.maximum(count, 1)[:, None, None]
    axes = np.linalg.eigh(square - np.einsum("ni,nj->nij", mean, mean))[1]  # the first is the normal
    z, x, y = np.moveaxis(offsets @ axes, 2, 0)
    design = np.stack([x * x / 2, x * y, y * y / 2, x, y, np.ones_like(x)], axis=2) * inside[..., None]
    normal = design.transpose(0, 2, 1) @ design + 1e-9 * np.eye(6)
    p1, p2, p3, p4, p5, _ = np.linalg.solve(normal, design.transpose(0, 2, 1) @ z[..., None])[..., 0].T
    a = p4**2 + 2 * p1**2 + 2 * p2**2
    b = p5**2 + 2 * p2**2 + 2 * p3**2
    c = p4 * p5 + 2 * p1 * p2 + 2 * p2 * p3
    return np.where(count >= FEWEST, a * b - c * c - k * (a + b) ** 2, 0)


def _balls(points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Offsets (n, m, 3) from each point to those around it over the radius, zero where there are fewer, and which ones
    are real."""
    from scipy.spatial import cKDTree

    tree = cKDTree(points)
    average = tree.count_neighbors(tree, radius) / len(points)
    support = points
    if average > ENOUGH:
        support = points[farthest_points(points, int(np.ceil(len(points) * ENOUGH / average)))]
    most = min(MOST, len(support))
    at = cKDTree(support).query(points, most, distance_upper_bound=radius)[1].reshape(len(points), most)
    inside = at < len(support)
    at[~inside] = 0
    return np.where(inside[..., None], (support[at] - points[:, None]) / radius, 0), inside
