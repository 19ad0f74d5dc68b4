"""Any triangle soup → one closed, oriented, manifold surface a hair outside of it, as the paper prepares meshes for its
descriptors.

After ManifoldPlus (Huang, Zhou, Guibas 2020): the boundary of what the outside reaches, moved back to the surface. Here
that boundary is a level of the distance to the soup, on a grid, cut by marching tetrahedra (Doi and Koide 1991), whose
result is a manifold whatever the field; manifold3d then takes away the vertices that flat places do not need, and keeps
it one. No kept library does all of it: manifold3d refuses soups; point-cloud-utils' port of Manifold (2018) did not
come back from a single triangle within ten minutes and lies half a cell off; pymeshlab is GPL.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import label
from scipy.spatial import cKDTree

from b23d.stages.geometry.cleaning import THIN, heights
from b23d.stages.geometry.nearest import cover, nearest_on_faces

LEAK = np.sqrt(3) / 2
"""Level, in cells. The longest edge of the tetrahedra is √3 cells: whatever edge crosses a face has an end nearer than
this."""
SKIN = 0.1
"""How far the result stays off the soup, in cells: the two sides of a sheet without thickness do not touch."""
REST = 0.05
"""Share of what a vertex is farther off than that which it keeps: vertices above each other do not meet."""
CUT = 0.1
"""Least share of an edge on either side of a cut: no triangle is degenerate."""
FLAT = (0.1, 0.05, 0.025)
"""How far, in cells, simplifying may move the surface: the first of these that leaves no face degenerate."""
CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
TETRAHEDRA = np.array([[0, 4, 6, 7], [0, 4, 5, 7], [0, 2, 6, 7], [0, 2, 3, 7], [0, 1, 5, 7], [0, 1, 3, 7]])
"""Six to a cell, around its diagonal (Kuhn 1960); rows index `CORNERS`."""


def watertight(vertices: np.ndarray, faces: np.ndarray, resolution: int) -> tuple[np.ndarray, np.ndarray]:
    """A closed surface around a soup: (v, 3) float32, (f, 3) int32; every edge is in exactly two faces, once each way,
    normals point out.

    vertices (v, 3), faces (f, 3) with an area each, unit frame; `resolution`: grid cells along the longest side. What
    is inside, and cannot be seen from without, is gone; gaps and holes narrower than some 1.7 cells are closed; an open
    sheet becomes a thin solid. Vertices lie within a fifth of a cell of the soup; flat places have few. Deterministic.
    """
    cell = 1.0 / resolution
    used = vertices[np.unique(faces)].astype(np.float64)
    origin = used.min(axis=0) - 3 * cell
    size = tuple(np.ceil((used.max(axis=0) + 3 * cell - origin) / cell).astype(int) + 1)
    inside, height = _level(vertices, faces, origin, size, cell)
    points, triangles = _marching_tetrahedra(inside, height, size)
    points = origin + points * cell
    on, distance = nearest_on_faces(points, vertices, faces)
    foot = on.points.astype(np.float64)
    kept = SKIN * cell + REST * np.maximum(distance - SKIN * cell, 0)
    points = foot + (points - foot) * (kept / np.maximum(distance, kept))[:, None]
    return _simplified(points.astype(np.float32), triangles, cell)


def _simplified(points: np.ndarray, triangles: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """The closed surface with some twentieth of its faces; as it is where that cannot be had without degenerate
    ones."""
    from manifold3d import Manifold, Mesh

    whole = Manifold(Mesh(points, triangles.astype(np.uint32)))
    for tolerance in FLAT:
        made = whole.simplify(tolerance * cell).to_mesh()
        vertices, faces = (
            np.asarray(made.vert_properties, np.float32)[:, :3],
            np.asarray(made.tri_verts).astype(np.int32),
        )
        if len(faces) and heights(vertices.astype(np.float64), faces).min() > THIN:
            return np.ascontiguousarray(vertices), faces
    return points, triangles


def uneven_edges(faces: np.ndarray) -> int:
    """How many edges are not in exactly two faces: 0 where the mesh is closed and no edge has a fin."""
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64), axis=1)
    return int((np.unique(edges[:, 0] * (int(faces.max()) + 1) + edges[:, 1], return_counts=True)[1] != 2).sum())


def _level(
    vertices: np.ndarray, faces: np.ndarray, origin: np.ndarray, size: tuple[int, ...], cell: float
) -> tuple[np.ndarray, np.ndarray]:
    """Which grid nodes the outside does not reach, (x·y·z,) bool, and each node's height above the level in cells,
    float64.

    Heights are approximate but where they decide the sign: the vertices they place are put right afterwards.
    """
    level = LEAK * cell
    anchors = cover(vertices, faces)
    nodes = origin + np.stack(np.unravel_index(np.arange(np.prod(size)), size), axis=1) * cell
    reach = level + anchors.radius + 2 * cell
    distance = np.minimum(cKDTree(anchors.points).query(nodes, distance_upper_bound=reach)[0], reach)
    unsure = np.flatnonzero(
        (distance >= level) & (distance < level + anchors.radius)
    )  # anchors are never nearer than the faces
    distance[unsure] = nearest_on_faces(nodes[unsure], vertices, faces)[1]
    step = np.ones((3, 3, 3), bool)  # along the tetrahedra's edges: no two axes in opposite directions
    offsets = np.stack(np.unravel_index(np.arange(27), (3, 3, 3)), axis=1) - 1
    step.ravel()[(offsets.min(axis=1) < 0) & (offsets.max(axis=1) > 0)] = False
    regions = label((distance >= level).reshape(size), step)[0].ravel()
    return regions != regions[0], np.abs(distance - level) / cell


def _marching_tetrahedra(
    inside: np.ndarray, height: np.ndarray, size: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) float64 in cells and faces (f, 3) int32 of the surface between the nodes inside and those
    outside."""
    at = np.stack(np.meshgrid(*(np.arange(n - 1) for n in size), indexing="ij"), axis=-1).reshape(-1, 3)
    strides = np.array([size[1] * size[2], size[2], 1])
    corners = (at @ strides)[:, None] + CORNERS @ strides
    counts = inside[corners].sum(axis=1)
    mixed = corners[(counts > 0) & (counts < 8)]
    tetrahedra = mixed[:, TETRAHEDRA].reshape(-1, 4)
    order = np.argsort(~inside[tetrahedra], axis=1, kind="stable")  # inside first
    tetrahedra = np.take_along_axis(tetrahedra, order, axis=1)
    counts = inside[tetrahedra].sum(axis=1)

    def cuts(within: int, *triangles: list[tuple[int, int]]) -> list[np.ndarray]:
        chosen = tetrahedra[counts == within]
        return [np.stack([chosen[:, pair] for pair in triangle], axis=1) for triangle in triangles]

    edges = np.concatenate(
        [
            *cuts(1, [(0, 1), (0, 2), (0, 3)]),
            *cuts(2, [(0, 2), (0, 3), (1, 3)], [(0, 2), (1, 3), (1, 2)]),
            *cuts(3, [(0, 3), (1, 3), (2, 3)]),
        ]
    )  # (f, 3 corners, 2 ends: inside, outside)
    ends = np.stack(np.unravel_index(edges, size), axis=-1).astype(np.float64)
    middles, outwards = ends.mean(axis=2), (ends[:, :, 1] - ends[:, :, 0]).sum(axis=1)
    normals = np.cross(middles[:, 1] - middles[:, 0], middles[:, 2] - middles[:, 0])
    flipped = np.einsum("fx,fx->f", normals, outwards) < 0
    edges[flipped] = edges[flipped][:, ::-1]

    keys, faces = np.unique(edges[..., 0] * inside.size + edges[..., 1], return_inverse=True)
    low, high = keys // inside.size, keys % inside.size
    share = np.clip(height[low] / np.maximum(height[low] + height[high], 1e-12), CUT, 1 - CUT)[:, None]
    start, stop = (np.stack(np.unravel_index(nodes, size), axis=1) for nodes in (low, high))
    return start * (1 - share) + stop * share, faces.reshape(-1, 3).astype(np.int32)
