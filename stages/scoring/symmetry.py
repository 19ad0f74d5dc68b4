"""Exchanges of names that a symmetry of the shape permits, from the annotation's `reflections` and `rotations`; and the
one that a half turn stands for, permitted or not.

KeypointNet lists pairs of ids that *some* mirror plane exchanges, without saying which pairs share a plane (a
rectangular bathtub has (0 1) (2 3) for one plane and (1 2) (3 0) for another), and its lists have gaps. But a symmetry
moves the whole shape: all pairs of one plane are exchanged at once or not at all. Which pairs share a plane, and which
further ids it exchanges, is read from the annotated positions.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt

from b23d.schemas.keypoints import Keypoints
from b23d.stages.scoring.motions import Motion, half_turn, mirror, turn

LARGEST_GROUP = 64
"""Composing symmetries ends at this many exchanges; a square's group has 8."""
AGREES = 0.5
"""A motion takes one id to another if it takes the point nearer to the other than this share of their distance."""

REFITS = 10
"""A half turn's axis is fitted anew to the ids it exchanges until they stay the same, or so often."""

Places = dict[int, np.ndarray]
IdPair = tuple[int, int]


def exchanges(keypoints: Keypoints, upright: np.ndarray) -> npt.NDArray[np.int32]:
    """For every permitted exchange, the id looked for at each annotated keypoint: (e, g) int32, the identity first.

    upright (g, 3): the keypoints' positions in a frame whose +y is up, as the annotation's own need not be.
    The exchanges are the identity, every reflection (all its pairs at once), every turn about the vertical that
    `rotations` lists and the positions bear out, and their compositions. Ids that the shape lacks stay out of
    exchanges.
    """
    ids = keypoints.ids.tolist()
    places = dict(zip(ids, np.asarray(upright, np.float64), strict=True))

    pairs = sorted({(min(pair), max(pair)) for pair in _usable(keypoints.reflections, places) if len(pair) == 2})
    tables = [_reflection(plane, places) for plane in _planes(pairs, places)]

    cycles = [cycle for cycle in _usable(keypoints.rotations, places) if len(cycle) > 1]
    for fold in sorted({len(cycle) for cycle in cycles}):
        tables.append(_rotation([cycle for cycle in cycles if len(cycle) == fold], places))

    generators = [[ids.index(table.get(i, i)) for i in ids] for table in tables]
    return np.stack(_compose(generators, keypoints.ids))


def fronts(ids: np.ndarray, upright: np.ndarray) -> npt.NDArray[np.int32]:
    """The id looked for at each annotated keypoint where the front is where it was annotated, and where it is opposite:
    (2, g) int32.

    ids (g,), upright (g, 3) their positions, +y up. A half turn about the vertical exchanges two ids where it takes
    each nearer to the other than `AGREES` of their distance, and nearest of all; its axis is the middle of all such
    pairs. Ids that it takes to no other keep their names: what has no counterpart at the other end is missed there.
    """
    names = ids.tolist()
    places = dict(zip(names, np.asarray(upright, np.float64), strict=True))
    table: dict[int, int] = {}
    middle = np.mean([*places.values()], axis=0) if places else np.zeros(3)
    for _ in range(REFITS):
        found = _matched(places, half_turn(middle))
        if not found or found == table:
            break
        table, middle = found, np.mean([places[i] for i in found], axis=0)
    return np.stack([ids, np.array([table.get(i, i) for i in names], np.int32)])


def _usable(tuples: Iterable[tuple[int, ...]], places: Places) -> list[tuple[int, ...]]:
    """The tuples of different ids that the shape has."""
    return [ids for ids in tuples if len(ids) == len(set(ids)) and places.keys() >= set(ids)]


def _planes(pairs: list[IdPair], places: Places) -> list[list[IdPair]]:
    """Pairs grouped by the mirror plane that exchanges them; the pair that defines the plane first.

    An id that stands in m pairs has a partner in m planes, so there are as many planes as the most frequent id has
    pairs, and its pairs define them (the widest ones, if several ids are as frequent). Any other pair goes to the plane
    that takes its one point nearest to the other, among those in which both are free.
    """
    degree = Counter(i for pair in pairs for i in pair)
    most = max(degree.values(), default=0)

    def width(pair: IdPair) -> float:
        return float(np.linalg.norm(places[pair[0]] - places[pair[1]]))

    widest = sorted(pairs, key=width, reverse=True)
    if most < 2:
        return [widest] if pairs else []

    frequent = [i for i in degree if degree[i] == most]
    candidates = [[pair for pair in pairs if i in pair] for i in frequent]
    seeds = max(candidates, key=lambda group: min(map(width, group)))
    planes = [[seed] for seed in seeds]
    for pair in widest:
        if pair not in seeds:
            _join(pair, planes, places)
    return planes


def _join(pair: IdPair, planes: list[list[IdPair]], places: Places) -> None:
    """Put the pair into the plane that exchanges it best, among those in which neither of its ids has a partner yet."""
    free = [plane for plane in planes if not any(set(pair) & set(other) for other in plane)]
    if not free:
        return

    def error(plane: list[IdPair]) -> float:
        a, b = plane[0]
        return _error(mirror(places[a], places[b]), pair, places)

    min(free, key=error).append(pair)


def _error(motion: Motion, pair: IdPair, places: Places) -> float:
    return float(np.linalg.norm(motion(places[pair[0]]) - places[pair[1]]))


def _reflection(plane: list[IdPair], places: Places) -> dict[int, int]:
    a, b = plane[0]
    return _complete({**dict(plane), **{j: i for i, j in plane}}, mirror(places[a], places[b]), places)


def _rotation(tuples: list[tuple[int, ...]], places: Places) -> dict[int, int]:
    motion = turn([np.stack([places[i] for i in ids]) for ids in tuples])
    table: dict[int, int] = {}
    for ids in tuples:
        following = (*ids[1:], ids[0])
        steps = dict(zip(ids, following, strict=True))
        if _borne_out(steps, motion, places) and not table.keys() & steps.keys():
            table.update(steps)
    return _complete(table, motion, places)


def _borne_out(steps: dict[int, int], motion: Motion, places: Places) -> bool:
    """Whether the motion takes every id near enough to where the step says."""
    return all(
        _error(motion, (i, j), places) < AGREES * np.linalg.norm(places[i] - places[j]) for i, j in steps.items()
    )


def _complete(table: dict[int, int], motion: Motion, places: Places) -> dict[int, int]:
    """The table with those other ids that the motion takes to one another, each being the other's nearest."""
    free = {i: place for i, place in places.items() if i not in table}
    return {**table, **_matched(free, motion)} if table else table


def _matched(places: Places, motion: Motion) -> dict[int, int]:
    """The ids that the motion takes to one another, each being the other's nearest; whole cycles of them."""
    if len(places) < 2:
        return {}
    ids, points = list(places), np.stack([*places.values()])
    gaps = np.linalg.norm(motion(points)[:, None] - points[None], axis=2)
    widths = np.linalg.norm(points[:, None] - points[None], axis=2)
    onto, back = gaps.argmin(1), gaps.argmin(0)
    near = gaps < AGREES * widths

    found = {i: int(j) for i, j in enumerate(onto) if i != j and back[j] == i and near[i, j]}
    while found.keys() != set(found.values()):  # whole cycles only
        ends = set(found.values())
        found = {i: j for i, j in found.items() if j in found and i in ends}
    return {ids[i]: ids[j] for i, j in found.items()}


def _compose(generators: list[list[int]], ids: np.ndarray) -> list[np.ndarray]:
    """All products of the generators (as positions in `ids`), each as the id that every id becomes; identity first."""
    found, seen = [ids], {tuple(ids.tolist())}
    for element in found:  # grows while it is walked: breadth first
        for generator in generators:
            product = element[generator]
            if tuple(product.tolist()) not in seen and len(found) < LARGEST_GROUP:
                seen.add(tuple(product.tolist()))
                found.append(product)
    return found
