"""Components of a shape joined over their shortest gaps, so that distances stay a finite metric."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.distance import cdist

ROWS = 1024
"""Rows of the point-to-point matrix held at once."""


def links(points: np.ndarray, components: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The fewest and shortest straight links that connect all components: a minimum spanning tree over them.

    Args:
        points: (n, 3) float64.
        components: (n,) int, labels 0 … c-1, each used.

    Returns:
        ends (c-1, 2) int64, point indices, and lengths (c-1,) float64 in the points' unit.
    """
    count = int(components.max()) + 1
    if count == 1:
        return np.empty((0, 2), dtype=np.int64), np.empty(0)
    order = np.argsort(components, kind="stable")
    starts = np.searchsorted(components[order], np.arange(count))
    gaps = np.concatenate(
        [
            np.minimum.reduceat(cdist(points[order[r : r + ROWS]], points[order]), starts, axis=1)
            for r in range(0, len(points), ROWS)
        ]
    )  # (n, c): each point's distance from each component
    between = np.minimum.reduceat(gaps, starts, axis=0)  # (c, c)
    tree = minimum_spanning_tree(
        csr_matrix(between + 1.0)
    ).tocoo()  # + 1: a gap of zero must not read as no edge; same tree
    pairs = zip(tree.row, tree.col, strict=True)
    ends = np.array(
        [[order[_nearest(gaps, starts, a, b)], order[_nearest(gaps, starts, b, a)]] for a, b in pairs], dtype=np.int64
    )
    return ends, np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)


def _nearest(gaps: np.ndarray, starts: np.ndarray, component: int, other: int) -> int:
    """Row of the point of `component` that is nearest to `other`."""
    rows = gaps[starts[component] : starts[component + 1] if component + 1 < len(starts) else None, other]
    return int(starts[component] + rows.argmin())
