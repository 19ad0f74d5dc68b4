"""Points on a surface: evenly spread random ones, and farthest-point samples of those."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.stages.geometry.cleaning import areas

DENSITY = 10
"""Random surface points drawn for each farthest-point sample wanted."""


@dataclass
class OnSurface:
    """Points and where on the mesh they lie: `points = Σ barycentrics · corners of faces[face]`."""

    points: np.ndarray
    """(n, 3) float32, the vertices' frame."""
    faces: np.ndarray
    """(n,) int32."""
    barycentrics: np.ndarray
    """(n, 3) float32, non-negative, sum 1."""

    def __getitem__(self, chosen: np.ndarray) -> OnSurface:
        return OnSurface(self.points[chosen], self.faces[chosen], self.barycentrics[chosen])


def surface_samples(vertices: np.ndarray, faces: np.ndarray, count: int, rng: np.random.Generator) -> OnSurface:
    """`count` points, by area: one at random in each of `count` equal slices of the cumulative area (stratified), and
    uniform within its triangle (Osada et al. 2002, Eq. 1).

    vertices (v, 3), faces (f, 3) of positive total area.
    """
    cumulative = np.cumsum(areas(vertices, faces))
    at = (np.arange(count) + rng.random(count)) / count * cumulative[-1]
    face = np.minimum(np.searchsorted(cumulative, at, side="right"), len(faces) - 1)
    root, other = np.sqrt(rng.random(count)), rng.random(count)
    barycentrics = np.stack([1 - root, root * (1 - other), root * other], axis=1)
    return place(vertices, faces, face, barycentrics)


def place(vertices: np.ndarray, faces: np.ndarray, face: np.ndarray, barycentrics: np.ndarray) -> OnSurface:
    """The points with these barycentric coordinates (n, 3) on these faces (n,)."""
    corners = vertices[faces[face]].astype(np.float64)
    points = np.einsum("nc,ncx->nx", barycentrics, corners)
    return OnSurface(points.astype(np.float32), face.astype(np.int32), barycentrics.astype(np.float32))


def farthest_points(points: np.ndarray, count: int) -> np.ndarray:
    """Indices (count,) of farthest-point samples of `points` (n, 3); all of them in order where n ≤ count.

    Eldar et al. 1997, by fpsample's bucket k-d tree (Han et al. 2023), which picks its own start. Deterministic.
    """
    import fpsample

    if len(points) <= count:
        return np.arange(len(points))
    height = min(6, int(np.log2(len(points))))
    if height < 1:
        return np.arange(count)
    chosen = fpsample.bucket_fps_kdline_sampling(np.ascontiguousarray(points, np.float32), count, h=height, start_idx=0)
    return np.asarray(chosen).astype(np.int64)
