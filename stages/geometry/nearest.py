"""The nearest face to each of many points, and where on it."""

from __future__ import annotations

import numpy as np

from stages.geometry.sampling import OnSurface, place, surface_samples

NEIGHBOURS = 24
"""Surface samples looked at around each point; the faces they lie on are then measured exactly."""


def nearest_on_faces(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray, samples: int = 20_000) -> tuple[OnSurface, np.ndarray]:
    """The nearest place on the mesh to each point (n, 3), and its distance (n,) float32.

    Exact distances to the faces of the `NEIGHBOURS` nearest of: every face's centre and `samples` points by area. So the
    face found may be wrong only where more than that many samples lie nearer than any on the true one; it is then about
    as near. (Measured against brute force: `tests/test_normalize.py`.)
    """
    from scipy.spatial import cKDTree

    if len(points) == 0:
        empty = np.zeros((0, 3))
        return place(vertices, faces, np.zeros(0, np.int64), empty), np.zeros(0, np.float32)
    spread = surface_samples(vertices, faces, samples, np.random.default_rng(0))
    anchors = np.concatenate([vertices[faces].mean(axis=1, dtype=np.float64), spread.points])
    owner = np.concatenate([np.arange(len(faces)), spread.faces])
    _, near = cKDTree(anchors).query(points, k=min(NEIGHBOURS, len(anchors)))
    candidates = owner[near.reshape(len(points), -1)]  # n × k faces

    flat = candidates.reshape(-1)
    barycentrics = nearest_barycentrics(np.repeat(points, candidates.shape[1], axis=0), vertices[faces[flat]])
    found = np.einsum("nc,ncx->nx", barycentrics, vertices[faces[flat]].astype(np.float64)).reshape(*candidates.shape, 3)
    distance = np.linalg.norm(found - points[:, None], axis=2)
    # Equally near faces share an edge: the lowest index wins, so that the samples' order plays no part.
    tied = np.where(distance <= distance.min(axis=1, keepdims=True) + 1e-9, candidates, len(faces))
    best = tied.argmin(axis=1)
    rows = np.arange(len(points))
    chosen = barycentrics.reshape(*candidates.shape, 3)[rows, best]
    return place(vertices, faces, candidates[rows, best], chosen), distance[rows, best].astype(np.float32)


def nearest_barycentrics(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Barycentric coordinates (n, 3) float64 of the nearest place to points[i] (n, 3) on triangles[i] (n, 3, 3).

    The foot of the perpendicular where that lies inside, else the nearest of the three edges' nearest places.
    """
    p = points.astype(np.float64)
    a, b, c = (triangles[:, i].astype(np.float64) for i in range(3))
    ab, ac, ap = b - a, c - a, p - a
    d00, d01, d11 = _dot(ab, ab), _dot(ab, ac), _dot(ac, ac)
    d20, d21 = _dot(ap, ab), _dot(ap, ac)
    determinant = d00 * d11 - d01 * d01
    safe = np.where(determinant > 0, determinant, 1)
    v, w = (d11 * d20 - d01 * d21) / safe, (d00 * d21 - d01 * d20) / safe
    inside = (determinant > 0) & (v >= 0) & (w >= 0) & (v + w <= 1)

    edges = np.zeros((3, len(p), 3))
    squared = np.empty((3, len(p)))
    for i, (start, stop) in enumerate(((0, 1), (1, 2), (2, 0))):  # the three edges
        origin, along = triangles[:, start].astype(np.float64), triangles[:, stop].astype(np.float64) - triangles[:, start]
        length = _dot(along, along)
        t = np.clip(_dot(p - origin, along) / np.where(length > 0, length, 1), 0, 1)
        edges[i, :, start], edges[i, :, stop] = 1 - t, t
        offset = origin + t[:, None] * along - p
        squared[i] = _dot(offset, offset)
    on_edge = edges[squared.argmin(axis=0), np.arange(len(p))]
    return np.where(inside[:, None], np.stack([1 - v - w, v, w], axis=1), on_edge)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("nx,nx->n", a, b)
