"""Neighbours that are near in space but not along the surface: edges through thin sheets and across narrow gaps."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from b23d.stages.geodesics.graph import edge_graph, label_components

STEEP = 0.5
"""An edge steeper than this sine against the surface at both ends leaves the surface (a chord of a circle: over
60°)."""
OPPOSED = -0.5
"""Outward normals with a smaller cosine look away from each other: the two sides of a sheet."""
PATCH = 12
"""Nearest points a cloud's normals are fitted to."""


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(f, 3) float64 unit normals by the faces' winding; zero for a face without area."""
    a, b, c = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
    normals = np.cross(b - a, c - a)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)


def consistently_wound(vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Whether neighbouring faces run through their common edge in opposite directions, so that normals have a side.

    Vertices at equal places count as one. False where over 5 % of the shared edges have another number of faces than
    two, or two that disagree (patches wound at random; sheets modelled as two coincident faces).
    """
    welded = np.unique(vertices, axis=0, return_inverse=True)[1].ravel()[faces]
    directed = np.concatenate([welded[:, [0, 1]], welded[:, [1, 2]], welded[:, [2, 0]]])
    ends = np.sort(directed, axis=1)
    which, count = np.unique(ends[:, 0] * len(vertices) + ends[:, 1], return_inverse=True, return_counts=True)[1:]
    turns = np.bincount(which.ravel(), weights=np.where(directed[:, 0] < directed[:, 1], 1.0, -1.0))
    shared = count > 1
    return bool(shared.any() and (turns[shared & (count == 2)] == 0).sum() >= 0.95 * shared.sum())


def cloud_normals(points: np.ndarray) -> np.ndarray:
    """(n, 3) float64 unit normals of arbitrary sign, from the principal axes of each point's nearest others."""
    near = cKDTree(points).query(points, min(PATCH, len(points)))[1].reshape(len(points), -1)
    offsets = points[near] - points[near].mean(axis=1, keepdims=True)
    return np.linalg.eigh(np.einsum("nki,nkj->nij", offsets, offsets))[1][:, :, 0]


def cut_shortcuts(
    points: np.ndarray, normals: np.ndarray, oriented: bool, edges: np.ndarray, lengths: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Drop the edges that leave the surface, wherever another way remains.

    An edge leaves the surface if it is steep against it at both ends, or, with `oriented` normals, if these oppose each
    other. Where dropping such edges would disconnect what was connected, those between the parts stay: a sheet whose
    rim has no samples, or a patch with its winding flipped.

    Args:
        points: (n, 3) float64; normals: (n, 3), of unit length or zero.
        oriented: whether the signs of the normals mean something.
        edges: (e, 2) int; lengths: (e,).

    Returns:
        The edges and lengths that stay.
    """
    first, second = edges.T
    along = points[second] - points[first]
    steep = (
        np.minimum(np.abs((along * normals[first]).sum(axis=1)), np.abs((along * normals[second]).sum(axis=1)))
        > STEEP * lengths
    )
    leaves = steep | ((normals[first] * normals[second]).sum(axis=1) < OPPOSED) if oriented else steep
    parts = label_components(edge_graph(len(points), edges[~leaves], lengths[~leaves]))
    stay = ~leaves | (parts[first] != parts[second])
    return edges[stay], lengths[stay]
