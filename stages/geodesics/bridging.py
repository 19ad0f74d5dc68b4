"""Components of a shape joined across their gaps, so that distances stay a finite metric.

A hole or a hidden strip parts a scan along its whole width. So components are joined not at their nearest points alone,
which would send every other path on a detour, but all along the gap between them.
"""

from __future__ import annotations

import numpy as np
from scipy.cluster.hierarchy import cophenet, linkage
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist, squareform

ROWS = 1024
"""Rows of the point-to-point matrix held at once."""
WIDE = 2.5
"""A gap is crossed wherever it is at most this many times as wide as the widest that has to be crossed between two
components, on the way between them with the narrowest gaps."""


def links(points: np.ndarray, components: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Straight links that connect all components: from each point to the nearest of every other component that is not
    `WIDE` times farther than need be, a minimum spanning tree over the components among them.

    Args:
        points: (n, 3) float64.
        components: (n,) int, labels 0 … c-1, each used.

    Returns:
        ends (l, 2) int64, point indices, smaller first, each pair once, and lengths (l,) float64 in the points' unit.
    """
    count = int(components.max()) + 1
    if count == 1:
        return np.empty((0, 2), dtype=np.int64), np.empty(0)
    order = np.argsort(components, kind="stable")
    starts = np.searchsorted(components[order], np.arange(count + 1))
    gaps = np.concatenate(
        [
            np.minimum.reduceat(cdist(points[order[r : r + ROWS]], points[order]), starts[:-1], axis=1)
            for r in range(0, len(points), ROWS)
        ]
    )  # (n, c): each point's distance from each component
    near = gaps <= WIDE * _widest(np.minimum.reduceat(gaps, starts[:-1], axis=0))[components[order]]
    near[np.arange(len(points)), components[order]] = False
    pairs = []
    for component in range(count):
        members = order[starts[component] : starts[component + 1]]
        others = order[near[:, component]]
        pairs.append(np.column_stack([others, members[cKDTree(points[members]).query(points[others])[1]]]))
    ends = np.unique(np.sort(np.concatenate(pairs), axis=1), axis=0)
    return ends, np.linalg.norm(points[ends[:, 0]] - points[ends[:, 1]], axis=1)


def _widest(between: np.ndarray) -> np.ndarray:
    """(c, c): the widest of the gaps (c, c) on the way from one component to another whose widest is the narrowest."""
    return np.asarray(squareform(cophenet(linkage(squareform(between, checks=False), "single"))))
