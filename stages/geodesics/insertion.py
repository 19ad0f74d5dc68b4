"""Points of a surface made vertices of its mesh, so that a mesh solver can start and end exactly at them."""

from __future__ import annotations

import numpy as np

INNER = 1e-3
"""Smallest barycentric coordinate of an inserted point: it moves by at most this share of an edge, and no new face is
empty."""


def insert_points(
    vertices: np.ndarray, faces: np.ndarray, point_faces: np.ndarray, barycentrics: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Split faces until every point is a vertex.

    Each round splits every face that still holds points at one of them, into three, and hands the others on to the part
    they lie in: about log(points a face) rounds. New faces keep the winding, and can be very thin: use solvers that
    re-triangulate (intrinsic Delaunay).

    Args:
        vertices: (v, 3) float64.
        faces: (f, 3) int.
        point_faces: (n,) int, the face each point lies on.
        barycentrics: (n, 3) float, its coordinates in that face.

    Returns:
        vertices (v + m, 3) float64, faces (f + 2 m, 3) int64, and the vertex (n,) int64 of each point. Points with
        equal coordinates share one vertex, so m may be less than n.
    """
    faces = np.asarray(faces, dtype=np.int64)
    face, weights, same = _distinct_points(point_faces, barycentrics)
    positions = np.einsum("mc,mcx->mx", weights, vertices[faces[face]])
    vertex = len(vertices) + np.arange(len(face))

    waiting = np.arange(len(face))  # points that are not a vertex yet; `face` and `weights` follow them into the parts
    while len(waiting):
        split, first = np.unique(face[waiting], return_index=True)
        chosen = waiting[first]  # (s,): the point that each of these faces is split at
        waiting = np.setdiff1d(waiting, chosen, assume_unique=True)
        row = np.searchsorted(split, face[waiting])  # every face that still holds points is split
        part, weights[waiting] = _within_part(weights[waiting], weights[chosen[row]])
        faces, children = _split_faces(faces, split, vertex[chosen])
        face[waiting] = children[row, part]
    return np.concatenate([vertices, positions]), faces, vertex[same]


def _distinct_points(point_faces: np.ndarray, barycentrics: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Faces (m,) and coordinates (m, 3), away from the faces' edges, of the different points; and which of them each
    point (n,) is."""
    inner = np.clip(np.asarray(barycentrics, dtype=np.float64), INNER, None)
    inner /= inner.sum(axis=1, keepdims=True)
    keys = np.column_stack([point_faces, inner.round(6)])
    _, first, same = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return np.asarray(point_faces, dtype=np.int64)[first], inner[first], same.ravel()


def _split_faces(faces: np.ndarray, split: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Faces with `split` (s,) in three parts each, and the parts' indices (s, 3): part i has corner i replaced by the
    new vertex, `corners` (s,). The first takes the place of the face, the others come last."""
    parts = np.repeat(faces[split][:, None], 3, axis=1)  # (s, part, corner)
    parts[:, np.arange(3), np.arange(3)] = corners[:, None]
    added = len(faces) + np.arange(2 * len(split)).reshape(-1, 2)
    faces = np.concatenate([faces, parts[:, 1:].reshape(-1, 3)])
    faces[split] = parts[:, 0]
    return faces, np.column_stack([split, added])


def _within_part(weights: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Part (w,) that points of coordinates `weights` (w, 3) are in, of faces split at coordinates `at` (w, 3), and
    their coordinates (w, 3) there.

    With x = Σ wᵢ cᵢ and the new vertex p = Σ aᵢ cᵢ, x = s p + Σ (wᵢ - s aᵢ) cᵢ: in the part in which s = min wᵢ / aᵢ
    nothing is negative, and its own corner's share is zero and p's is s.
    """
    points, ratio = np.arange(len(weights)), weights / at
    part = ratio.argmin(axis=1)
    share = ratio[points, part]
    rest = weights - share[:, None] * at
    rest[points, part] = share
    rest = np.clip(rest, INNER * 1e-3, None)
    return part, rest / rest.sum(axis=1, keepdims=True)
