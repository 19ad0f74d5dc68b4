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
    inner = np.clip(np.asarray(barycentrics, dtype=np.float64), INNER, None)
    inner /= inner.sum(axis=1, keepdims=True)
    keys = np.column_stack([point_faces, inner.round(6)])
    _, first, same = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    place, weights = np.asarray(point_faces, dtype=np.int64)[first], inner[first]  # (m,), (m, 3)
    faces = np.asarray(faces, dtype=np.int64)
    positions = np.einsum("mc,mcx->mx", weights, vertices[faces[place]])
    new = len(vertices) + np.arange(len(first))

    pending = np.arange(len(first))
    while len(pending):
        split, chosen = np.unique(place[pending], return_index=True)
        chosen = pending[chosen]
        pending = np.setdiff1d(pending, chosen, assume_unique=True)
        parts = np.repeat(faces[split][:, None], 3, axis=1)  # (s, part, 3): part i has corner i replaced by the point
        parts[:, np.arange(3), np.arange(3)] = new[chosen][:, None]
        children = np.column_stack([split, len(faces) + np.arange(2 * len(split)).reshape(-1, 2)])  # (s, part)

        row = np.searchsorted(split, place[pending])
        hit = row < len(split)
        hit[hit] = split[row[hit]] == place[pending][hit]
        moved, row = pending[hit], row[hit]
        ratio = weights[moved] / weights[chosen[row]]
        part = ratio.argmin(axis=1)
        share = ratio[np.arange(len(moved)), part]  # coordinate of the splitting point
        rest = weights[moved] - share[:, None] * weights[chosen[row]]
        rest[np.arange(len(moved)), part] = share
        rest = np.clip(rest, INNER * 1e-3, None)
        weights[moved] = rest / rest.sum(axis=1, keepdims=True)
        place[moved] = children[row, part]
        faces = np.concatenate([faces, parts[:, 1:].reshape(-1, 3)])
        faces[split] = parts[:, 0]
    return np.concatenate([vertices, positions]), faces, new[same.ravel()]
