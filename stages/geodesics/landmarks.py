"""Distances between very many points by way of landmarks, where exact ones would take minutes and gigabytes.

From each landmark to every point the shortest paths are exact, and so they are from every point to those near it. Any
other path is taken to pass by one of the landmarks next to either of its ends: never too short, and too long by a
fraction of the landmarks' spacing (the idea of de Silva and Tenenbaum's landmark Isomap, 2003).
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from b23d.stages.geodesics.graph import label_components
from b23d.stages.geometry.sampling import farthest_points

LANDMARKS = 1024
NEXT = 8
"""Landmarks around an end that a path may pass by."""
NEAR = 3.0
"""Radius of exact distances around every point, in spacings of the landmarks."""
ROWS = 256


def landmark_distances(graph: csr_matrix, points: np.ndarray, count: int = LANDMARKS) -> np.ndarray:
    """Distances between all points along a graph.

    Args:
        graph: (n, n) symmetric, non-negative edge lengths.
        points: (n, 3), where the points are, in the lengths' unit.
        count: of landmarks; each component has at least one.

    Returns:
        (n, n) float16, symmetric, zero diagonal, inf where there is no path; never less than the shortest path, but for
        rounding.
    """
    n = len(points)
    of_each_component = np.unique(label_components(graph), return_index=True)[1]
    landmarks = np.union1d(farthest_points(points, min(count, n)), of_each_component)
    from_landmarks = np.asarray(dijkstra(graph, indices=landmarks), np.float32)  # (l, n)
    spacing = 2 * float(np.median(from_landmarks.min(axis=0)))
    distances = np.empty((n, n), np.float16)
    for start in range(0, n, ROWS):
        block = slice(start, start + ROWS)
        through = np.asarray(dijkstra(graph, indices=np.arange(n)[block], limit=NEAR * spacing), np.float32)
        near = from_landmarks[:, block]
        for rank in np.argsort(near, axis=0)[:NEXT]:  # (rows,): one landmark for each point of the block
            by_way = from_landmarks[rank] + near[rank, np.arange(near.shape[1])][:, None]
            np.minimum(through, by_way, out=through)
        distances[block] = through
    for start in range(0, n, ROWS):
        block = slice(start, start + ROWS)
        both = np.minimum(distances[block, start:], distances[start:, block].T)
        distances[block, start:], distances[start:, block] = both, both.T
    return distances
