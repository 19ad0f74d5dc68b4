"""A graph embedded in space, taken apart: two sides and the few points that separate them, again and again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix

LEAF = 128
"""Points below which a part is not taken apart: its separator would be half of it."""
LARGEST = 3
"""A separator of more than a third of a part is none."""
LEAST = 0.25
"""Share of a part's points that lie on either side of a cut, at least."""
BELOW = 2.2
"""Work below a cut, of a side of m points: this times m^2.5, as where the separators of a surface have some 3 √m
points."""


@dataclass(frozen=True)
class Part:
    """Places `start … stop` of an order: two sides, `start … middle` and `middle … separator`, and then what separates
    them. Both sides are empty where it was not taken apart."""

    start: int
    middle: int
    separator: int
    stop: int


def dissect(graph: csr_matrix, points: np.ndarray) -> tuple[np.ndarray, list[Part]]:
    """Nested dissection (Lipton, Rose and Tarjan 1979) by planes across x, y or z.

    Args:
        graph: (n, n) symmetric; what is stored is an edge.
        points: (n, 3), where its points are.

    Returns:
        order (n,): point at each place; the parts, each after those it is made of. No edge joins a part's two sides.
    """
    parts: list[Part] = []
    return _take_apart(graph, points, np.arange(len(points)), 0, parts), parts


def _take_apart(graph: csr_matrix, points: np.ndarray, names: np.ndarray, start: int, parts: list[Part]) -> np.ndarray:
    stop = start + len(names)
    found = _separate(graph, points) if len(names) > LEAF else None
    if found is None:
        parts.append(Part(start, start, start, stop))
        return names
    first, second, separator = found
    middle, end = start + len(first), stop - len(separator)
    order = [
        _take_apart(graph[side][:, side], points[side], names[side], place, parts)
        for side, place in ((first, start), (second, middle))
    ]
    parts.append(Part(start, middle, end, stop))
    return np.concatenate([*order, names[separator]])


def _separate(graph: csr_matrix, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """Both sides of the cut that promises the least work, and the points on one side of it with an edge across, which
    are in neither; None if they are too many."""
    count = len(points)
    cuts = np.arange(int(count * LEAST), count - int(count * LEAST) + 1)
    least, best = np.inf, (np.empty(0, bool), np.empty(0, bool))
    for along in points.T:
        place = np.empty(count, np.int64)
        place[np.argsort(along, kind="stable")] = np.arange(count)
        first, last = _reach(graph, place)
        # of the points below and above each cut, those with an edge across it
        below = cuts - np.searchsorted(np.sort(last), cuts)
        above = np.searchsorted(np.sort(first), cuts) - cuts
        for low, high, separators, here, there in (
            (place, last, below, cuts - below, count - cuts),
            (first, place, above, cuts, count - cuts - above),
        ):
            work = separators * count**2 / 2 + BELOW * (here**2.5 + there**2.5)
            at = int(work.argmin())
            if work[at] < least:
                least, best = work[at], (place < cuts[at], (low < cuts[at]) & (high >= cuts[at]))
    under, separator = best
    if separator.sum() > count // LARGEST:
        return None
    return np.flatnonzero(under & ~separator), np.flatnonzero(~under & ~separator), np.flatnonzero(separator)


def _reach(graph: csr_matrix, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The first and the last place of every point and its neighbours."""
    first, last = place.copy(), place.copy()
    linked = np.flatnonzero(np.diff(graph.indptr))
    if len(linked):
        starts, neighbours = graph.indptr[linked], place[graph.indices]
        first[linked] = np.minimum(first[linked], np.minimum.reduceat(neighbours, starts))
        last[linked] = np.maximum(last[linked], np.maximum.reduceat(neighbours, starts))
    return first, last
