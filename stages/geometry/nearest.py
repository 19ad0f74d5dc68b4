"""The nearest face to each of many points, and where on it: exact for points on or near a mesh, in bounded time.

Hand-written on scipy's tree: of equally near faces the first, whatever the machine, and a bound on the work for each
point; trimesh.proximity (with rtree), libigl and open3d would each be one more dependency for this one question.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from b23d.stages.geometry.sampling import OnSurface, place

CELL = 0.01
"""Side of the cells that faces are cut into, unit frame; larger where that would give more than `MOST` cells."""
MOST = 500_000
LIMIT = 2000
"""A point with more anchors than this in reach (far from the mesh, or amid thousands of needles) looks only at the
faces of its `NEIGHBOURS` nearest anchors: the face it gets is then near, not certainly the nearest."""
NEIGHBOURS = 32


@dataclass
class Anchors:
    """Points such that every place on a face is within `radius` of one of the anchors of that face."""

    points: np.ndarray
    """(m, 3) float64."""
    faces: np.ndarray
    """(m,) int64, the face of each."""
    radius: float


def nearest_on_faces(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> tuple[OnSurface, np.ndarray]:
    """The nearest place on the mesh to each point (n, 3), and its distance (n,) float64; of equally near faces the
    first.

    Unit frame. The face of the nearest anchor gives an upper bound; a nearer face has an anchor within that bound and
    the covering radius, so those faces, and no others, are measured exactly.
    """
    points = points.astype(np.float64)
    if not len(points):
        return place(vertices, faces, np.zeros(0, np.int64), np.zeros((0, 3))), np.zeros(0)
    anchors = cover(vertices, faces)
    tree = cKDTree(anchors.points)
    neighbours = tree.query(points, k=min(NEIGHBOURS, len(anchors.points)))[1].reshape(len(points), -1)
    bound = np.linalg.norm(_nearest(points, vertices, faces, anchors.faces[neighbours[:, 0]])[1] - points, axis=1)
    reach = bound + anchors.radius + 1e-9
    reach[tree.query_ball_point(points, reach, return_length=True) > LIMIT] = 0
    near = [
        np.append(found, beside) for found, beside in zip(tree.query_ball_point(points, reach), neighbours, strict=True)
    ]
    owner = np.repeat(np.arange(len(points)), [len(found) for found in near])
    candidate = anchors.faces[np.concatenate(near).astype(np.int64)]
    pairs = np.unique(owner * len(faces) + candidate)  # by point, then by face
    owner, candidate = pairs // len(faces), pairs % len(faces)

    barycentrics, places = _nearest(points[owner], vertices, faces, candidate)
    distance = np.linalg.norm(places - points[owner], axis=1)
    starts = np.searchsorted(owner, np.arange(len(points)))
    least = np.minimum.reduceat(distance, starts)
    as_near = np.flatnonzero(distance <= least[owner] + 1e-9)
    best = as_near[np.searchsorted(owner[as_near], np.arange(len(points)))]
    return place(vertices, faces, candidate[best], barycentrics[best]), distance[best]


def cover(vertices: np.ndarray, faces: np.ndarray) -> Anchors:
    """The centres of square cells laid over each face, in rows along its longest side; a needle takes one row.

    A row's cells span its longer edge, so some centres lie just outside the face; that serves as well.
    """
    corners = vertices[faces].astype(np.float64)
    sides = np.roll(corners, -1, axis=1) - corners
    longest = np.einsum("fsx,fsx->fs", sides, sides).argmax(axis=1)
    every = np.arange(len(faces))
    a, along, apex = (
        corners[every, longest],
        sides[every, longest],
        corners[every, (longest + 2) % 3] - corners[every, longest],
    )
    length = np.linalg.norm(along, axis=1)
    along /= length[:, None]
    foot = np.einsum("fx,fx->f", apex, along)
    across = apex - foot[:, None] * along
    height = np.linalg.norm(across, axis=1)
    across /= np.maximum(height, np.finfo(np.float64).tiny)[:, None]

    cell = _cell(length, height)
    rows = np.maximum(np.ceil(height / cell), 1).astype(np.int64)
    face = np.repeat(every, rows)
    row = _count_up(rows)
    below = row / rows[face]  # of the height
    width = length[face] * (1 - below)
    columns = np.maximum(np.ceil(width / cell), 1).astype(np.int64)
    line = np.repeat(np.arange(len(face)), columns)
    x = foot[face[line]] * below[line] + width[line] * (_count_up(columns) + 0.5) / columns[line]
    y = height[face[line]] * (row[line] + 0.5) / rows[face[line]]
    owner = face[line]
    return Anchors(a[owner] + x[:, None] * along[owner] + y[:, None] * across[owner], owner, cell / np.sqrt(2))


def nearest_barycentrics(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Barycentric coordinates (n, 3) float64 of the nearest place to points[i] (n, 3) on triangles[i] (n, 3, 3).

    The foot of the perpendicular where that lies inside, or the nearest place of the three edges, whichever is nearer
    (in exact arithmetic the foot; on a triangle that is hardly one, the foot is not reliable).
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
    offset = v[:, None] * ab + w[:, None] * ac - ap

    choices = np.zeros((4, len(p), 3))
    squared = np.empty((4, len(p)))
    choices[0] = np.stack([1 - v - w, v, w], axis=1)
    squared[0] = np.where(inside, _dot(offset, offset), np.inf)
    for i, (start, stop) in enumerate(((0, 1), (1, 2), (2, 0)), start=1):
        origin, along = (
            triangles[:, start].astype(np.float64),
            triangles[:, stop].astype(np.float64) - triangles[:, start],
        )
        length = _dot(along, along)
        t = np.clip(_dot(p - origin, along) / np.where(length > 0, length, 1), 0, 1)
        choices[i, :, start], choices[i, :, stop] = 1 - t, t
        offset = origin + t[:, None] * along - p
        squared[i] = _dot(offset, offset)
    return choices[squared.argmin(axis=0), np.arange(len(p))]


def _nearest(
    points: np.ndarray, vertices: np.ndarray, faces: np.ndarray, face: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Barycentrics and position (n, 3) of the nearest place to points[i] on face[i]."""
    triangles = vertices[faces[face]].astype(np.float64)
    barycentrics = nearest_barycentrics(points, triangles)
    return barycentrics, np.einsum("nc,ncx->nx", barycentrics, triangles)


def _cell(length: np.ndarray, height: np.ndarray) -> float:
    """The cell's side: `CELL`, doubled until at most about `MOST` cells and one a face are needed."""
    cell = CELL
    while (length * height / 2).sum() / cell**2 + length.sum() / cell > MOST:
        cell *= 2
    return cell


def _count_up(counts: np.ndarray) -> np.ndarray:
    """0, 1, … counts[0] - 1, 0, 1, … counts[1] - 1, …"""
    return np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("nx,nx->n", a, b)
