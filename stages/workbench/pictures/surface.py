"""A shape's surface as a page can carry it: few enough faces, 16-bit vertices, normals for shading."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from b23d.schemas.shape import NormalizedShape
from b23d.stages.workbench.pictures.packing import curve_order, pack, pack_places

FACES = 5_000  # as fine as candidates colour them; they take some 30 kB of a page
EDGE = (
    0.03  # unit frame; longer edges are divided, so that colours at vertices follow candidates, which lie 0.015 apart
)
NEIGHBORS = 12


@dataclass(frozen=True)
class PageSurface:
    vertices: np.ndarray
    """(v, 3) float32, unit frame."""
    faces: np.ndarray
    """(f, 3) int32."""
    coarse: bool
    """Vertices of one grid cell were merged: the mesh has more faces than this."""


def surface_of(shape: NormalizedShape, limit: int = FACES) -> PageSurface | None:
    """The shape's mesh with about `limit` faces at most and no unused vertex; None for a cloud.

    Too many faces: vertices are merged cell by cell of a grid (Rossignac and Borrel 1993), coarser until they are few
    enough. Large faces: divided, while there is room.
    """
    if shape.kind == "cloud":
        return None
    vertices, faces = _used(shape.vertices, shape.faces)
    cells = 256
    coarse = len(faces) > limit
    found = (vertices, faces)
    while len(found[1]) > limit and cells > 8:
        found = _clustered(vertices, faces, cells)
        cells = int(cells / 1.3)
    if not coarse:
        found = _divided(*found, limit)
    return PageSurface(found[0].astype(np.float32), found[1].astype(np.int32), coarse)


def pack_surface(surface: PageSurface) -> dict[str, Any]:
    """The surface as packed arrays. Vertices are in the order in which faces first use them; `faces` says how far each
    corner lies below the next vertex to come (0: it is that vertex), which packs small."""
    ordered = _by_first_use(surface)
    corners = ordered.faces.reshape(-1)
    coming = 1 + np.maximum.accumulate(np.concatenate([[-1], corners]))[:-1]
    index = np.uint16 if len(ordered.vertices) <= 65535 else np.int32
    return {
        "vertices": pack_places(ordered.vertices),
        "faces": pack((coming - corners).astype(index)),
        "coarse": surface.coarse,
    }


def _by_first_use(surface: PageSurface) -> PageSurface:
    """The same surface with neighbours near each other in its arrays, which packs better."""
    faces = surface.faces[curve_order(surface.vertices[surface.faces].mean(axis=1))]
    used, first = np.unique(faces, return_index=True)
    order = used[np.argsort(first)]
    renumbered = np.empty(len(surface.vertices), np.int32)
    renumbered[order] = np.arange(len(order))
    return PageSurface(surface.vertices[order], renumbered[faces], surface.coarse)


def point_normals(shape: NormalizedShape) -> np.ndarray:
    """(n, 3) float32 unit normals of the candidates, of either sign: their face's, or that of the plane through near
    points."""
    if shape.kind == "mesh" and (shape.point_faces >= 0).all():
        corners = shape.vertices[shape.faces[shape.point_faces]].astype(np.float64)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    else:
        from scipy.spatial import cKDTree

        points = shape.points.astype(np.float64)
        _, near = cKDTree(points).query(points, k=min(NEIGHBORS, len(points)))
        around = points[near.reshape(len(points), -1)]
        around = around - around.mean(axis=1, keepdims=True)
        _, vectors = np.linalg.eigh(np.einsum("nkx,nky->nxy", around, around))
        normals = vectors[:, :, 0]
    return (normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)).astype(np.float32)


def _divided(vertices: np.ndarray, faces: np.ndarray, limit: int) -> tuple[np.ndarray, np.ndarray]:
    """Faces with an edge longer than `EDGE` cut in two there, again and again, those with the longest first, up to
    `limit` faces."""
    while True:
        corners = vertices[faces]
        lengths = np.linalg.norm(
            np.roll(corners, -1, axis=1) - corners, axis=2
        )  # of the edge from each corner to the next
        longest = lengths.max(axis=1)
        order = np.argsort(-longest, kind="stable")
        cut = order[: min(int((longest > EDGE).sum()), limit - len(faces))]
        if not len(cut):
            places, merged = np.unique(vertices, axis=0, return_inverse=True)  # each cut made its own middle
            return _used(places, merged.reshape(-1)[faces])
        start = lengths[cut].argmax(axis=1)
        a, b, c = (faces[cut, (start + i) % 3] for i in range(3))
        middle = np.arange(len(cut)) + len(vertices)
        vertices = np.concatenate([vertices, (vertices[a] + vertices[b]) / 2])
        whole = np.delete(faces, cut, axis=0)
        faces = np.concatenate([whole, np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


def _used(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    kept, renumbered = np.unique(faces, return_inverse=True)
    return vertices[kept], renumbered.reshape(faces.shape)


def _clustered(vertices: np.ndarray, faces: np.ndarray, cells: int) -> tuple[np.ndarray, np.ndarray]:
    low, side = vertices.min(axis=0), float(np.ptp(vertices, axis=0).max()) or 1.0
    cell = ((vertices - low) / side * cells).astype(np.int64)
    key = (cell[:, 0] * (cells + 1) + cell[:, 1]) * (cells + 1) + cell[:, 2]
    _, cluster, counts = np.unique(key, return_inverse=True, return_counts=True)
    cluster = cluster.reshape(-1)
    merged = np.stack([np.bincount(cluster, vertices[:, axis]) for axis in range(3)], axis=1) / counts[:, None]
    corners = cluster[faces]
    whole = (corners[:, 0] != corners[:, 1]) & (corners[:, 1] != corners[:, 2]) & (corners[:, 2] != corners[:, 0])
    _, first = np.unique(np.sort(corners[whole], axis=1), axis=0, return_index=True)
    return _used(merged, corners[whole][np.sort(first)])
