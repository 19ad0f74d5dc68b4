"""geodesic: distances along the surface between all candidates of a shape."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.features import GeodesicDistances
from b23d.schemas.params import Params, When
from b23d.schemas.shape import NormalizedShape


class Links(Params):
    """A graph of the candidates."""

    neighbors: int = Field(default=20, ge=1)
    """Nearest others each candidate is linked to. With "heat", the links along which its distances are joined and
    shortened (and, on clouds, its Laplacian's)."""
    disconnected: Literal["bridge", "max", "infinite"] = "bridge"
    """Between components: "bridge" joins them where they touch and all along their narrow gaps, so that distances stay
    a metric; "max" takes the largest finite distance (the released code); "infinite" leaves +inf."""


class GraphLinks(Links):
    shortcuts: Literal["keep", "cut"] = "keep"
    """What to do with links that leave the surface, through a thin sheet or across a gap. "cut" drops those that are
    steep against the surface at both ends or, on a consistently wound mesh, join opposite sides, wherever another way
    remains."""


class GeodesicParams(Params):
    """How distances are measured (DIFFERENCES.md, row 8)."""

    method: Literal["graph", "heat", "euclidean"] = "graph"
    """"graph": shortest paths in the candidates' nearest-neighbour graph, as KeypointNet scores. "heat": the heat
    method on the mesh (on the candidates themselves where there is no mesh): right on thin parts, too, at some five
    times the cost. "euclidean": straight lines, for comparison."""
    graph: Annotated[GraphLinks, When(method="graph")] = GraphLinks()
    heat: Annotated[Links, When(method="heat")] = Links()


EXACT = 8192
"""Candidates up to which all distances are exact."""
ROWS = 1024
"""Of the matrix held in double precision at once."""


@stage(version=3, hints=Hints(memory_gb=0.5))
def geodesic(normalize: NormalizedShape, params: GeodesicParams) -> GeodesicDistances:
    """Geodesic distances between all candidates, in the unit frame, never less than the straight line.

    "graph" takes O(n k) edges and O(n²) memory; exact all-pairs shortest paths (`stages/geodesics/paths.py`). Of more
    than 8,192 candidates they go by way of landmarks (`stages/geodesics/landmarks.py`: .1 to .2 % too long in the mean,
    single short distances up to some 20 %), and `method` says so. "heat" solves once a candidate, averages both
    directions, and takes paths along links of that length where they are shorter.

    Raises ValueError where the shape has no candidates, or one that is not finite; where "heat" is asked for more than
    8,192.
    """
    points = normalize.points.astype(np.float64)
    if not len(points) or not np.isfinite(points).all():
        raise ValueError(
            f"candidates: expected at least one and all finite, got {points.shape}; run normalize on the shape again"
        )
    many = len(points) > EXACT
    if params.method == "graph":
        distances, components = _along_graph(normalize, points, params.graph)
        _fill(distances, params.graph)
    elif params.method == "heat":
        if many:
            raise ValueError(
                f'candidates: expected at most {EXACT} for "heat", which solves once for each, got {len(points)}; '
                'lower stages.normalize.count, or take "graph"'
            )
        distances, components = _by_heat(normalize, points, params.heat)
        _fill(distances, params.heat)
    else:
        distances, components = _straight_halves(points), np.zeros(len(points), np.int32)
    np.fill_diagonal(distances, 0)
    method = f"{params.method} by landmarks" if many and params.method == "graph" else params.method
    return GeodesicDistances(distances=distances.astype(np.float16, copy=False), components=components, method=method)


def _along_graph(shape: NormalizedShape, points: np.ndarray, links: GraphLinks) -> tuple[np.ndarray, np.ndarray]:
    from b23d.stages.geodesics.graph import edge_graph, label_components, neighbour_edges
    from b23d.stages.geodesics.shortcuts import cloud_normals, consistently_wound, cut_shortcuts, face_normals

    edges, lengths = neighbour_edges(points, links.neighbors)
    components = label_components(edge_graph(len(points), edges, lengths))
    if links.shortcuts == "cut":
        if _on_mesh(shape):
            normals = face_normals(shape.vertices, shape.faces)[shape.point_faces]
            oriented = consistently_wound(shape.vertices, shape.faces)
        else:
            normals, oriented = cloud_normals(points), False
        edges, lengths = cut_shortcuts(points, normals, oriented, edges, lengths)
    return _joined_paths(points, edges, lengths, links), components


def _by_heat(shape: NormalizedShape, points: np.ndarray, links: Links) -> tuple[np.ndarray, np.ndarray]:
    from b23d.stages.geodesics.graph import neighbour_edges
    from b23d.stages.geodesics.heat import cloud_distances, mesh_distances

    if _on_mesh(shape):
        distances, components = mesh_distances(shape.vertices, shape.faces, shape.point_faces, shape.point_barycentrics)
    else:
        distances, components = cloud_distances(points, links.neighbors)
    distances = (distances + distances.T) / 2
    np.maximum(distances, _straight(points), out=distances)  # NaN stays

    # Heat's distances are no metric: paths along links of heat's length are shorter where it errs, and join components
    # that touch.
    edges, lengths = neighbour_edges(points, links.neighbors)
    first, second = edges.T
    inside = components[first] == components[second]
    if links.disconnected != "bridge":
        edges, lengths, first, second = edges[inside], lengths[inside], first[inside], second[inside]
    solved = distances[first, second]
    lengths = np.where(np.isfinite(solved), solved, lengths)
    return np.fmin(distances, _joined_paths(points, edges, lengths, links)), components


def _joined_paths(points: np.ndarray, edges: np.ndarray, lengths: np.ndarray, links: Links) -> np.ndarray:
    from b23d.stages.geodesics.bridging import links as bridges
    from b23d.stages.geodesics.graph import edge_graph, label_components
    from b23d.stages.geodesics.landmarks import landmark_distances
    from b23d.stages.geodesics.paths import all_pairs

    graph = edge_graph(len(points), edges, lengths)
    if links.disconnected == "bridge":
        ends, gaps = bridges(points, label_components(graph))
        graph = edge_graph(len(points), np.concatenate([edges, ends]), np.concatenate([lengths, gaps]))
    return landmark_distances(graph, points) if len(points) > EXACT else all_pairs(graph, points)


def _fill(distances: np.ndarray, links: Links) -> None:
    """Where that is asked for, give pairs that no path joins the largest distance of any other."""
    if links.disconnected == "max":
        unreachable = np.isinf(distances)
        distances[unreachable] = distances[~unreachable].max()


def _on_mesh(shape: NormalizedShape) -> bool:
    return len(shape.faces) > 0 and bool((shape.point_faces >= 0).all())


def _straight(points: np.ndarray) -> np.ndarray:
    from scipy.spatial.distance import cdist

    return cdist(points, points).astype(np.float32)


def _straight_halves(points: np.ndarray) -> np.ndarray:
    """(n, n) float16, a few rows at a time."""
    from scipy.spatial.distance import cdist

    distances = np.empty((len(points), len(points)), np.float16)
    for start in range(0, len(points), ROWS):
        distances[start : start + ROWS] = cdist(points[start : start + ROWS], points)
    return distances
