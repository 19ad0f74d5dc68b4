"""Why an annotation does not lie on its shape: units, frames and orders of axes are tried in turn."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from b23d.schemas.shape import NormalizedShape

UNITS = {
    1000.0: "millimetres for metres", 100.0: "centimetres for metres", 10.0: "millimetres for centimetres",
    1 / 0.0254: "inches for metres", 25.4: "millimetres for inches", 2.54: "centimetres for inches",
    1 / 0.3048: "feet for metres", 12.0: "inches for feet", 304.8: "millimetres for feet",
}  # fmt: skip
EXACT = 0.005
"""A mistake explains an annotation exactly if, undone, it brings every keypoint this near, unit frame."""
FITS = 0.02
"""A mistake explains an annotation if, undone, it brings every keypoint at least this near, unit frame."""
SPREAD = 0.1
"""Keypoints that undoing would draw together more than this explain nothing: any place is near a heap."""
STEPS = 20  # of fitting an offset


@dataclass(frozen=True)
class Cause:
    words: str
    distance: float
    """Of the farthest keypoint, once undone; unit frame."""
    single: bool
    """One mistake without a free number: it hardly fits by chance, as an offset, or two mistakes, can."""


def cause(positions: npt.NDArray[np.float64], shape: NormalizedShape, surface: npt.NDArray[np.float64]) -> Cause | None:
    """The simplest mistake that explains the keypoints' positions (k, 3), source frame; None where none does, or there
    are too few to tell.

    surface: (n, 3) places on the shape, dense, unit frame.
    """
    if len(positions) < 3:
        return None
    tree = cKDTree(surface)
    scaled = _best(_units(), positions, shape, tree, single=True)
    ratio = _best(_ratios(positions, shape), positions, shape, tree, single=False)
    tiers = [
        lambda: scaled if scaled.distance < 3 * ratio.distance else ratio,
        lambda: _best(_turns(), positions, shape, tree, single=True),
        lambda: _best(_frames(shape), positions, shape, tree, single=True),
        lambda: _best(_both(list(_units())), positions, shape, tree, single=False),
        lambda: _best(_both(list(_frames(shape))), positions, shape, tree, single=False),
        lambda: ratio,
        lambda: _offset(positions, shape, tree),
    ]
    return next((found for tier in tiers if (found := tier()).distance <= FITS), None)


Undo = Callable[[np.ndarray], np.ndarray]
"""Positions (k, 3) as they were annotated → as they would be without the mistake, source frame."""


def _times(factor: float) -> Undo:
    return lambda p: p * factor


def _reordered(order: tuple[int, ...], sign: tuple[int, ...]) -> Undo:
    return lambda p: p[:, list(order)] * np.array(sign)


def _then(first: Undo, second: Undo) -> Undo:
    return lambda p: second(first(p))


def _best(
    tier: Iterator[tuple[str, Undo]], positions: np.ndarray, shape: NormalizedShape, tree: cKDTree, single: bool
) -> Cause:
    """Of equally near ones the first."""
    tried = [Cause(words, _farthest(tree, shape, undo(positions)), single) for words, undo in tier]
    return min(tried, key=lambda one: one.distance)


def _farthest(tree: cKDTree, shape: NormalizedShape, positions: np.ndarray) -> float:
    unit = shape.to_unit(positions)
    if np.ptp(unit, axis=0).max() < SPREAD or not np.isfinite(unit).all():
        return np.inf
    return float(tree.query(unit)[0].max())


def _units() -> Iterator[tuple[str, Undo]]:
    for factor, units in UNITS.items():
        yield f"scaled ×{factor:.4g} ({units})", _times(1 / factor)
        one, _, other = units.partition(" for ")
        yield f"scaled ×{1 / factor:.4g} ({other} for {one})", _times(factor)
    for factor in (1e4, 1e5, 1e6):
        yield f"scaled ×{factor:.4g}", _times(1 / factor)
        yield f"scaled ×{1 / factor:.4g}", _times(factor)


def _turns() -> Iterator[tuple[str, Undo]]:
    """Axes in another order or direction; the fewest changes of direction first."""
    signs = sorted(product((1, -1), repeat=3), key=lambda s: s.count(-1))
    for sign, order in product(signs, permutations(range(3))):
        if order == (0, 1, 2) and sign == (1, 1, 1):
            continue
        yield _axes(order, sign), _reordered(order, sign)


def _axes(order: tuple[int, ...], sign: tuple[int, ...]) -> str:
    """What was done: `axes y and z swapped`, `x mirrored`, or the axes as they stand: `axes read as (x, z, -y)`."""
    moved = [axis for axis in range(3) if order[axis] != axis]
    if all(s == 1 for s in sign) and len(moved) == 2:
        return f"axes {'xyz'[moved[0]]} and {'xyz'[moved[1]]} swapped"
    if not moved:
        mirrored = " and ".join("xyz"[axis] for axis in range(3) if sign[axis] < 0)
        return f"{mirrored} mirrored"
    read = ", ".join(f"{'-' if s < 0 else ''}{'xyz'[axis]}" for axis, s in zip(order, sign, strict=True))
    return f"axes in another order: right as ({read})"


def _frames(shape: NormalizedShape) -> Iterator[tuple[str, Undo]]:
    """Normalised frames in use, undone into the source frame."""
    points = shape.vertices[np.unique(shape.faces)] if len(shape.faces) else shape.vertices
    source = shape.to_source(points.astype(np.float64))
    low, high = source.min(axis=0), source.max(axis=0)
    middle, mean, side = (low + high) / 2, source.mean(axis=0), float((high - low).max())
    about_box, about_mean = (float(np.linalg.norm(source - c, axis=1).max()) for c in (middle, mean))
    yield "in a frame normalised to longest side 1, centred", lambda p: p * side + middle
    yield "in a frame normalised to −1 … 1", lambda p: p * side / 2 + middle
    yield "in a frame normalised to 0 … 1", lambda p: p * side + low
    yield "in a frame normalised to diagonal 1", lambda p: p * float(np.linalg.norm(high - low)) + middle
    yield "in a frame normalised to the unit sphere", lambda p: p * about_box + middle
    yield "in a frame normalised to the unit sphere about the mean", lambda p: p * about_mean + mean
    yield "in a frame normalised to a sphere of diameter 1", lambda p: p * 2 * about_box + middle
    yield "in a frame centred on the box", lambda p: p + middle
    yield "in a frame centred on the mean", lambda p: p + mean
    yield "in a frame that stands on 0", lambda p: p + np.array([middle[0], low[1], middle[2]])


def _both(first: list[tuple[str, Undo]]) -> Iterator[tuple[str, Undo]]:
    for (words, undo), (axes, turn) in product(first, list(_turns())):
        yield f"{words}, and {axes}", _then(turn, undo)


def _ratios(positions: np.ndarray, shape: NormalizedShape) -> Iterator[tuple[str, Undo]]:
    """A factor of no known unit: that of how far keypoints and surface reach from the origin."""
    source = shape.to_source(shape.points.astype(np.float64))
    for axis in range(3):
        reach = np.abs(source[:, axis]).max()
        factor = float(np.abs(positions[:, axis]).max() / reach) if reach else 0.0
        if factor:
            yield f"scaled ×{factor:.4g}", _times(1 / factor)
    yield "scaled", _times(1.0)


def _offset(positions: np.ndarray, shape: NormalizedShape, tree: cKDTree) -> Cause:
    """An offset, fitted: keypoints are moved by the mean way to their nearest places, over and over."""
    unit = shape.to_unit(positions)
    middle = (unit.max(axis=0) + unit.min(axis=0)) / 2  # the shape's is the origin
    best: tuple[float, np.ndarray] = (np.inf, np.zeros(3))
    for start in (np.zeros(3), -middle, -unit.mean(axis=0)):
        moved = start
        for _ in range(STEPS):
            nearest = tree.data[tree.query(unit + moved)[1]]
            moved = moved + (nearest - unit - moved).mean(axis=0)
        distance = float(tree.query(unit + moved)[0].max())
        best = min(best, (distance, moved), key=lambda one: one[0])
    away = shape.to_source(np.zeros(3)) - shape.to_source(best[1])
    digits = 2 - int(np.floor(np.log10(shape.scale)))
    x, y, z = (round(float(c), digits) + 0.0 for c in away)
    return Cause(f"offset by ({x:g}, {y:g}, {z:g})", best[0], single=False)
