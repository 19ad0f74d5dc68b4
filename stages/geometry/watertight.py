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
TRIANGLES = {
    1: [[(0, 1), (0, 2), (0, 3)]],
    2: [[(0, 2), (0, 3), (1, 3)], [(0, 2), (1, 3), (1, 2)]],
    3: [[(0, 3), (1, 3), (2, 3)]],
}
"""How many of a tetrahedron's nodes are inside, these first → the triangles that cut it, each corner on an edge."""


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
    extent = used.max(axis=0) + 3 * cell - origin
    size = tuple(np.ceil(extent / cell).astype(int) + 1)
    inside, height = _level(vertices, faces, origin, size, cell)
    points, triangles = _marching_tetrahedra(inside, height, size)
    points = _drawn_in(origin + points * cell, vertices, faces, cell)
    return _simplified(points.astype(np.float32), triangles, cell)


def _drawn_in(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray, cell: float) -> np.ndarray:
    """The level's vertices (v, 3), each moved towards the nearest place on the soup until `SKIN` and `REST` remain."""
    on, distance = nearest_on_faces(points, vertices, faces)
    foot = on.points.astype(np.float64)
    skin = SKIN * cell
    kept = skin + REST * np.maximum(distance - skin, 0)
    share = kept / np.maximum(distance, kept)
    return foot + (points - foot) * share[:, None]


def _simplified(points: np.ndarray, triangles: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
    """The closed surface with some twentieth of its faces; as it is where that cannot be had without degenerate
    ones."""
    from manifold3d import Manifold, Mesh

    whole = Manifold(Mesh(points, triangles.astype(np.uint32)))
    for tolerance in FLAT:
        made = whole.simplify(tolerance * cell).to_mesh()
        vertices = np.asarray(made.vert_properties, np.float32)[:, :3]
        faces = np.asarray(made.tri_verts).astype(np.int32)
        if len(faces) and heights(vertices.astype(np.float64), faces).min() > THIN:
            return np.ascontiguousarray(vertices), faces
    return points, triangles


def uneven_edges(faces: np.ndarray) -> int:
    """How many edges are not in exactly two faces: 0 where the mesh is closed and no edge has a fin."""
    ends = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2).astype(np.int64)
    ends = np.sort(ends, axis=1)
    keys = ends[:, 0] * (int(faces.max()) + 1) + ends[:, 1]
    faces_of_edge = np.unique(keys, return_counts=True)[1]
    return int((faces_of_edge != 2).sum())


def one_closed_surface(vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Whether a mesh is one connected closed surface already, its faces wound outwards all round."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    starts = faces.reshape(-1).astype(np.int64)
    ends = np.roll(faces, -1, axis=1).reshape(-1).astype(np.int64)
    count = int(faces.max()) + 1
    there, back = np.sort(starts * count + ends), np.sort(ends * count + starts)
    each_edge_once_each_way = bool((np.diff(there) > 0).all()) and np.array_equal(there, back)
    if not each_edge_once_each_way:
        return False
    links = coo_array((np.ones(len(starts), bool), (starts, ends)), shape=(count, count))
    parts = connected_components(links, directed=False)[1]
    a, b, c = vertices[faces].astype(np.float64).transpose(1, 0, 2)
    volume = float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
    return len(np.unique(parts[faces])) == 1 and volume > 0


def _level(
    vertices: np.ndarray, faces: np.ndarray, origin: np.ndarray, size: tuple[int, ...], cell: float
) -> tuple[np.ndarray, np.ndarray]:
    """Which grid nodes the outside does not reach, (x·y·z,) bool, and each node's height above the level in cells,
    float64.

    Heights are approximate but where they decide the sign: the vertices they place are put right afterwards.
    """
    level = LEAK * cell
    every = np.arange(np.prod(size))
    nodes = origin + _coordinates(every, size) * cell
    distance = _distances(nodes, vertices, faces, level, cell)
    outside_or_hollow = (distance >= level).reshape(size)
    regions = label(outside_or_hollow, _neighbours())[0].ravel()
    inside = regions != regions[0]  # the first node is outside: the grid reaches 3 cells beyond the soup
    return inside, np.abs(distance - level) / cell


def _distances(nodes: np.ndarray, vertices: np.ndarray, faces: np.ndarray, level: float, cell: float) -> np.ndarray:
    """Distance (n,) of each node to the soup: exact where it decides on which side of the level the node is, else to
    the nearest anchor, and no more than some 2 cells beyond the level."""
    anchors = cover(vertices, faces)
    reach = level + anchors.radius + 2 * cell
    to_anchor = cKDTree(anchors.points).query(nodes, distance_upper_bound=reach)[0]
    distance = np.minimum(to_anchor, reach)
    may_be_nearer = distance < level + anchors.radius
    unsure = np.flatnonzero((distance >= level) & may_be_nearer)  # anchors are never nearer than the faces
    distance[unsure] = nearest_on_faces(nodes[unsure], vertices, faces)[1]
    return distance


def _neighbours() -> np.ndarray:
    """Which of the (3, 3, 3) nodes around one are joined to it by an edge of the tetrahedra: those to which no two axes
    go in opposite directions."""
    offsets = _coordinates(np.arange(27), (3, 3, 3)) - 1
    opposite = (offsets.min(axis=1) < 0) & (offsets.max(axis=1) > 0)
    return ~opposite.reshape(3, 3, 3)


def _marching_tetrahedra(
    inside: np.ndarray, height: np.ndarray, size: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (v, 3) float64 in cells and faces (f, 3) int32 of the surface between the nodes inside and those
    outside.

    Not manifold3d's `level_set`: it asks a Python function for one place after another (562,000 times on a grid of 64),
    on a lattice of its own, and what the outside reaches is known at our nodes only.
    """
    edges = _cut_edges(_mixed_tetrahedra(inside, size), inside)
    edges = _facing_out(edges, size)
    keys, faces = np.unique(edges[..., 0] * inside.size + edges[..., 1], return_inverse=True)
    within, without = keys // inside.size, keys % inside.size
    depth, rise = height[within], height[without]
    share = np.clip(depth / np.maximum(depth + rise, 1e-12), CUT, 1 - CUT)[:, None]
    points = _coordinates(within, size) * (1 - share) + _coordinates(without, size) * share
    return points, faces.reshape(-1, 3).astype(np.int32)


def _mixed_tetrahedra(inside: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    """The tetrahedra (t, 4 nodes, those inside first) of all cells that have nodes on both sides."""
    axes = [np.arange(n - 1) for n in size]
    cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    strides = np.array([size[1] * size[2], size[2], 1])
    corners = (cells @ strides)[:, None] + CORNERS @ strides
    counts = inside[corners].sum(axis=1)
    mixed = corners[(counts > 0) & (counts < 8)]
    tetrahedra = mixed[:, TETRAHEDRA].reshape(-1, 4)
    inside_first = np.argsort(~inside[tetrahedra], axis=1, kind="stable")
    return np.take_along_axis(tetrahedra, inside_first, axis=1)


def _cut_edges(tetrahedra: np.ndarray, inside: np.ndarray) -> np.ndarray:
    """The surface's triangles by the edges that their corners lie on: (f, 3 corners, 2 ends: inside, outside)."""
    counts = inside[tetrahedra].sum(axis=1)
    found = []
    for count, triangles in TRIANGLES.items():
        chosen = tetrahedra[counts == count]
        found += [chosen[:, np.array(triangle)] for triangle in triangles]
    return np.concatenate(found)


def _facing_out(edges: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    """The triangles, those turned round that face the nodes inside."""
    ends = _coordinates(edges, size).astype(np.float64)
    middles = ends.mean(axis=2)
    outwards = (ends[:, :, 1] - ends[:, :, 0]).sum(axis=1)
    normals = np.cross(middles[:, 1] - middles[:, 0], middles[:, 2] - middles[:, 0])
    inwards = np.einsum("fx,fx->f", normals, outwards) < 0
    return np.where(inwards[:, None, None], edges[:, ::-1], edges)


def _coordinates(nodes: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    """Node numbers (…) → their places in the grid (…, 3), in cells."""
    return np.stack(np.unravel_index(nodes, size), axis=-1)
