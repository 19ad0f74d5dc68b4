"""Geodesic distances by the heat method (Crane, Weischedel, Wardetzky 2013), through potpourri3d.

potpourri3d ends the whole process at an unreferenced vertex or an index out of range, and gives nonsense across
components: every solver here sees one component, compacted, whose points are its vertices.
"""

from __future__ import annotations

import numpy as np
from potpourri3d import MeshHeatMethodDistanceSolver, PointCloudHeatSolver

from b23d.stages.geodesics.connectivity import face_components, weld
from b23d.stages.geodesics.graph import edge_graph, label_components, neighbour_edges
from b23d.stages.geodesics.insertion import insert_points

FEWEST = 8
"""A cloud's component of fewer points has no tangent planes to speak of."""


def mesh_distances(
    vertices: np.ndarray, faces: np.ndarray, point_faces: np.ndarray, barycentrics: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distances along a mesh between points on it, which are inserted as vertices: exact places, no interpolation.

    Solved on the intrinsic Delaunay triangulation of the tufted cover (Sharp and Crane 2020), which takes non-manifold
    edges and thin faces. Costs two back-substitutions a point.

    Args:
        vertices: (v, 3) float; those at equal places are welded, those no face uses are ignored.
        faces: (f, 3) int.
        point_faces: (n,) int, face of each point; barycentrics: (n, 3).

    Returns:
        distances (n, n) float32, inf between components and NaN within one that could not be solved, and components
        (n,) int32: the connected part of the mesh each point is on, 0 … c-1.
    """
    places, faces = weld(vertices, faces)
    of_face = face_components(len(places), faces)
    components = np.unique(of_face[point_faces], return_inverse=True)[1].ravel().astype(np.int32)
    distances = np.full((len(point_faces), len(point_faces)), np.inf, dtype=np.float32)
    for component in range(int(components.max()) + 1):
        members = np.flatnonzero(components == component)
        part = np.flatnonzero(of_face == of_face[point_faces[members[0]]])
        on = np.searchsorted(part, point_faces[members])
        inserted, split, at = insert_points(places, faces[part], on, barycentrics[members])
        used, compact = np.unique(split, return_inverse=True)
        at = np.searchsorted(used, at)
        distances[np.ix_(members, members)] = _solve(
            MeshHeatMethodDistanceSolver, (inserted[used], compact.reshape(split.shape)), at
        )
    return distances, components


def cloud_distances(points: np.ndarray, neighbors: int) -> tuple[np.ndarray, np.ndarray]:
    """Distances along the surface a cloud samples, between all of its points; coincident points count as one.

    Components are those of the symmetric k-nearest-neighbour graph. Same returns as `mesh_distances`; a component of
    fewer than eight places is not solved.
    """
    places, at = np.unique(np.asarray(points, dtype=np.float64), axis=0, return_inverse=True)
    components = label_components(edge_graph(len(points), *neighbour_edges(points, neighbors)))
    distances = np.full((len(points), len(points)), np.inf, dtype=np.float32)
    for component in range(int(components.max()) + 1):
        members = np.flatnonzero(components == component)
        used, compact = np.unique(at.ravel()[members], return_inverse=True)
        distances[np.ix_(members, members)] = _solve(PointCloudHeatSolver, (places[used],), compact.ravel(), FEWEST)
    return distances, components


def _solve(solver: type, geometry: tuple[np.ndarray, ...], at: np.ndarray, fewest: int = 1) -> np.ndarray:
    """(m, m) float32 distances between vertices `at`; NaN where the solver fails."""
    sources, back = np.unique(at, return_inverse=True)
    if len(sources) == 1:
        return np.zeros((len(at), len(at)), dtype=np.float32)
    solved = np.full((len(sources), len(sources)), np.nan, dtype=np.float32)
    if len(geometry[0]) >= fewest:
        try:
            bound = solver(*geometry)
            for row, source in enumerate(sources):
                solved[row] = bound.compute_distance(int(source))[sources]
        except (RuntimeError, ValueError):  # what its C++ throws: no factorization, a degenerate geometry
            solved[:] = np.nan
    return solved[np.ix_(back.ravel(), back.ravel())]
