"""Maps between two shapes by looks and mutual distances (the paper's D), from several starts."""

from __future__ import annotations

import numpy as np

LANDMARKS = 64
STARTS = 8
"""Places that the first landmark is tried at, `APART` from one another: looks do not tell left from right."""
APART = 0.1
ALPHA = 10.0
"""Weight of a difference of distances, in longest sides, against one of cosines."""
CLIP = 0.2
"""Larger differences of distances count as this: poses change some, and other builds all."""
BEST = 3
"""Starts that are followed up."""
SWEEPS, ROUNDS = 4, 2
ROWS = 32
"""Points whose costs are added up at a time: few enough that their table stays in a core's cache."""


def guesses(alike: np.ndarray, own: np.ndarray, theirs: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """Costs and (n,) maps, the least first: for each point of one shape the point of the other, such that points look
    alike and lie as far from matched landmarks as they do here. Those of the best few starts.

    `alike` (n, m) likeness; `own` (n, n) and `theirs` (m, m) distances along the surfaces, unit frames. Landmarks are
    matched one after another, then improved in turn.
    """
    at = landmarks(own)
    looks, between = alike[at], own[np.ix_(at, at)]
    tried: dict[bytes, tuple[float, np.ndarray]] = {}
    for start in _starts(looks[0], theirs):
        paid, matched = _matched(looks, between, theirs, start)
        tried[matched.tobytes()] = paid, matched
    found = []
    for _, matched in sorted(tried.values(), key=lambda guess: guess[0])[:BEST]:
        for _ in range(ROUNDS):
            dense = _dense(alike, own[:, at], theirs[:, matched])
            matched = dense[at]
        found.append((cost(dense, at, alike, own, theirs), dense))
    return sorted(found, key=lambda guess: guess[0])


def landmarks(own: np.ndarray) -> np.ndarray:
    """The points (l,) of a shape that stand for it, by (n, n) distances."""
    return spread(own, min(LANDMARKS, len(own)))


def cost(matched: np.ndarray, at: np.ndarray, alike: np.ndarray, own: np.ndarray, theirs: np.ndarray) -> float:
    """Of a map (n,): how far the mutual distances of landmarks `at` (l,) change, how little points are alike, and how
    little of the other shape is reached."""
    reached = len(np.unique(matched)) / len(matched)
    bent = _bent(own[np.ix_(at, at)], theirs, matched[at])
    return bent - float(alike[np.arange(len(matched)), matched].mean()) - reached


def _bent(between: np.ndarray, theirs: np.ndarray, found: np.ndarray) -> float:
    """What it costs that landmarks, `between` (l, l) apart here, are as far apart there as their matches (l,)."""
    return float(ALPHA * np.minimum(np.abs(between - theirs[np.ix_(found, found)]), CLIP).mean())


def spread(distances: np.ndarray, count: int) -> np.ndarray:
    """(count,) farthest points by (n, n) distances, from the one that is farthest from the first."""
    chosen = [int(distances[0].argmax())]
    nearest = distances[chosen[0]].copy()
    while len(chosen) < count:
        chosen.append(int(nearest.argmax()))
        np.minimum(nearest, distances[chosen[-1]], out=nearest)
    return np.array(chosen)


def _starts(looks: np.ndarray, theirs: np.ndarray) -> list[int]:
    left = looks.copy()
    starts: list[int] = []
    while len(starts) < STARTS and np.isfinite(left.max()):
        starts.append(int(left.argmax()))
        left[theirs[starts[-1]] < APART] = -np.inf
    return starts


def _matched(looks: np.ndarray, between: np.ndarray, theirs: np.ndarray, start: int) -> tuple[float, np.ndarray]:
    """Cost and (l,) matches of the landmarks: looks (l, m), distances between them (l, l)."""
    count = len(looks)
    found = np.full(count, start)

    def best(landmark: int, others: np.ndarray) -> int:
        differ = np.abs(between[landmark, others][:, None] - theirs[found[others]])
        return int((ALPHA * np.minimum(differ, CLIP).mean(axis=0) - looks[landmark]).argmin())

    for landmark in range(1, count):
        found[landmark] = best(landmark, np.arange(landmark))
    for _ in range(SWEEPS if count > 1 else 0):
        before = found.copy()
        for landmark in range(count):
            found[landmark] = best(landmark, np.delete(np.arange(count), landmark))
        if np.array_equal(found, before):
            break
    return _bent(between, theirs, found) - float(looks[np.arange(count), found].mean()), found


def _dense(alike: np.ndarray, own: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """(n,) of least cost, given distances from landmarks here (n, l) and from their matches there (m, l)."""
    found = np.empty(len(alike), np.int64)
    there = np.ascontiguousarray(theirs.T)
    for start in range(0, len(alike), ROWS):
        rows = slice(start, start + ROWS)
        total, differ = np.zeros((2, *alike[rows].shape), np.float32)
        for here, other in zip(own[rows].T, there, strict=True):
            np.subtract(here[:, None], other, out=differ)
            np.abs(differ, out=differ)
            np.minimum(differ, np.float32(CLIP), out=differ)
            total += differ
        found[rows] = (total * np.float32(ALPHA / len(there)) - alike[rows]).argmin(axis=1)
    return found
