"""All-pairs shortest paths on a graph embedded in space, by divide and conquer.

Taken apart into two sides A, B and the points S that separate them (`stages/geodesics/dissection.py`), every path
between the sides goes through S, and a path within one side that leaves it does so too. From the paths within A alone
and within B alone, W being the edges and ⊗ the min-plus product, (x ⊗ y)[i, j] = min_k x[i, k] + y[k, j]:

    T = W[S, A] ⊗ D[A, A]                      from S straight into A, and likewise into B
    D[S, S] = closure of min(W[S, S], T ⊗ W[A, S], …)
    D[S, A] = D[S, S] ⊗ T
    D[A, A] = min(D[A, A], D[A, S] ⊗ D[S, A])
    D[A, B] = D[A, S] ⊗ D[S, B]

Exact. Nearly all of it is dense min-plus products, a quarter of the time of Dijkstra from every point for clouds of
2,048.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.distance import cdist

from b23d.stages.geodesics.dissection import Part, dissect

ROWS = 128
"""Of a product at once: only those columns are computed that lie right of a strip's first row."""


def all_pairs(graph: csr_matrix, points: np.ndarray) -> np.ndarray:
    """Lengths of the shortest paths between all points.

    Args:
        graph: (n, n) symmetric, non-negative edge lengths; explicit zeros are edges.
        points: (n, 3), where the points are; only speed depends on it.

    Returns:
        (n, n) float32, symmetric, zero diagonal, inf where there is no path. Exact up to float32 rounding.
    """
    order, parts = dissect(graph, points)
    edges = graph[order][:, order]
    far = float(np.float32(1 + len(points) * edges.data.max(initial=0)))  # longer than any path, and finite
    distances = np.empty(graph.shape, np.float32)
    for part in parts:
        if part.start == part.separator:
            whole = slice(part.start, part.stop)
            within = np.minimum(dijkstra(edges[whole, whole]), far)
            distances[whole, whole] = np.minimum(within, within.T)
        else:
            _join(distances, edges, part, far)
    distances[distances >= far] = np.inf
    place = np.empty(len(points), np.int64)
    place[order] = np.arange(len(points))
    return distances[np.ix_(place, place)]


def _join(distances: np.ndarray, edges: csr_matrix, part: Part, far: float) -> None:
    """Fill in a part's square, whose two sides' own squares hold the paths within each of them alone."""
    sides = slice(part.start, part.middle), slice(part.middle, part.separator)
    between = slice(part.separator, part.stop)
    around = edges[between, between].tocoo()
    closed = np.full(around.shape, far)
    closed[around.row, around.col] = around.data
    np.fill_diagonal(closed, 0)
    straight = []
    for side in sides:
        into, back = _straight(edges[between, side], distances[side, side], far)
        closed = np.minimum(closed, back)
        straight.append(into)
    closed = np.minimum(closed, closed.T)
    for by in range(len(closed)):  # Floyd and Warshall's
        np.minimum(closed, closed[:, by, None] + closed[by], out=closed)
    distances[between, between] = closed
    through = [np.minimum(_min_plus(into.T, closed, far), far) for into in straight]  # (a, s)
    for side, to in zip(sides, through, strict=True):
        distances[side, between], distances[between, side] = to, to.T
        _relax(distances[side, side], to, far)
    first, second = through
    for row in range(0, len(first), ROWS):
        here = slice(part.start + row, min(part.start + row + ROWS, part.middle))
        distances[here, sides[1]] = _min_plus(first[row : row + ROWS], second, far)
        distances[sides[1], here] = distances[here, sides[1]].T


def _straight(edges: csr_matrix, within: np.ndarray, far: float) -> tuple[np.ndarray, np.ndarray]:
    """From each point of the separator over one of its edges (s, a) into a side, whose own paths are (a, a): to the
    side's points (s, a), and back over another edge (s, s)."""
    into, back = np.full(edges.shape, far), np.full((edges.shape[0],) * 2, far)
    if len(linked := np.flatnonzero(np.diff(edges.indptr))):
        starts = edges.indptr[linked]
        into[linked] = np.minimum.reduceat(within[edges.indices] + edges.data[:, None], starts, axis=0)
        back[:, linked] = np.minimum.reduceat(into[:, edges.indices] + edges.data, starts, axis=1)
    return into, back


def _relax(within: np.ndarray, to: np.ndarray, far: float) -> None:
    """In place, a symmetric (a, a): what is shorter by way of a separator at distances (a, s)."""
    for row in range(0, len(within), ROWS):
        strip = within[row : row + ROWS, row:]
        np.minimum(strip, _min_plus(to[row : row + ROWS], to[row:], far), out=strip, casting="same_kind")
        within[row:, row : row + ROWS] = strip.T


def _min_plus(first: np.ndarray, second: np.ndarray, far: float) -> np.ndarray:
    """(a, b) float64: min over s of first (a, s) + second (b, s), none of them above `far`.

    As top - max |(top - first) - second|, the Chebyshev distance, which scipy has compiled: three times as fast as
    numpy's sum and minimum. That top is some hundred times the largest length costs three of double precision's
    sixteen digits.
    """
    if not first.shape[1]:
        return np.full((len(first), len(second)), far)
    top = 4 * far
    return top - cdist(top - first, second, "chebyshev")
