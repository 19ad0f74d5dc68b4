"""The symmetric k-nearest-neighbour graph of a cloud, and distances along it."""

from __future__ import annotations

from typing import Literal

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from b23d.stages.geodesics.bridging import links


def neighbour_edges(points: np.ndarray, neighbors: int) -> tuple[np.ndarray, np.ndarray]:
    """Every point with its `neighbors` nearest others (all others, if there are fewer).

    Args:
        points: (n, 3) float64.
        neighbors: k ≥ 1. A point is not its own neighbour; one that coincides with it is.

    Returns:
        edges (e, 2) int64, each pair once, smaller index first, sorted; lengths (e,) float64 in the points' unit.
    """
    count = len(points)
    wanted = min(neighbors, count - 1)
    if wanted < 1:
        return np.empty((0, 2), dtype=np.int64), np.empty(0)
    found = cKDTree(points).query(points, wanted + 1)[1]
    own = found == np.arange(count)[:, None]
    own[~own.any(axis=1), -1] = True  # more coincident points than places: the point itself is not in its own list
    others = found[~own].reshape(count, wanted)
    pairs = np.column_stack([np.repeat(np.arange(count), wanted), others.ravel()])
    pairs.sort(axis=1)
    keys = np.unique(pairs[:, 0] * count + pairs[:, 1])
    edges = np.column_stack([keys // count, keys % count])
    return edges, np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)


def edge_graph(count: int, edges: np.ndarray, lengths: np.ndarray) -> csr_matrix:
    """The (count, count) symmetric graph of undirected `edges` (e, 2), lengths (e,); a zero length stays an edge."""
    rows, columns = np.concatenate([edges, edges[:, ::-1]]).T
    return csr_matrix((np.concatenate([lengths, lengths]), (rows, columns)), shape=(count, count))


def label_components(graph: csr_matrix) -> np.ndarray:
    """(n,) int32, the connected component of each point: 0 … c-1."""
    return connected_components(graph, directed=False)[1].astype(np.int32)


def graph_distances(
    points: np.ndarray, neighbors: int, sources: np.ndarray, disconnected: Literal["infinite", "bridge"] = "infinite"
) -> np.ndarray:
    """Distances from a few points to all, along the symmetric k-nearest-neighbour graph; exact in float64.

    This is KeypointNet's measure (20 neighbours), and works in whatever unit the points have.

    Args:
        points: (n, 3) float.
        neighbors: nearest others of each point that it is linked to.
        sources: (s,) int, indices of points.
        disconnected: "infinite" leaves inf where no path exists; "bridge" first joins components over their shortest
        gaps.

    Returns:
        (s, n) float64.

    Raises:
        ValueError: no points, a point that is not finite, or a source out of range.
    """
    points, sources = np.asarray(points, dtype=np.float64), np.asarray(sources, dtype=np.int64)
    if not len(points) or not np.isfinite(points).all():
        raise ValueError(
            f"points: expected at least one and all finite, got {points.shape}; drop what is not finite first"
        )
    if len(sources) and (sources.min() < 0 or sources.max() >= len(points)):
        raise ValueError(
            f"sources: expected indices below {len(points)}, got {sources.min()} … {sources.max()}; "
            "index the same cloud"
        )
    edges, lengths = neighbour_edges(points, neighbors)
    graph = edge_graph(len(points), edges, lengths)
    if disconnected == "bridge":
        ends, gaps = links(points, label_components(graph))
        graph = edge_graph(len(points), np.concatenate([edges, ends]), np.concatenate([lengths, gaps]))
    return np.atleast_2d(dijkstra(graph, indices=sources)) if len(sources) else np.empty((0, len(points)))
