"""Why an annotation does not lie on its shape: units, frames and orders of axes are tried in turn."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
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
UP = {(1, 1, -1): "z up for y up", (1, -1, 1): "y up for z up"}
"""Signs of (x, z, y) that turn one into the other → what was mixed up."""
EXACT = 0.005
"""A mistake explains an annotation exactly if, undone, it brings every keypoint this near, unit frame."""
FITS = 0.02
"""A mistake explains an annotation if, undone, it brings every keypoint at least this near, unit frame."""
SPREAD = 0.1
"""Keypoints that undoing would draw together more than this explain nothing: any place is near a heap."""
STEPS = 20  # of fitting an offset


FLOOR = 0.003
"""Mistakes that bring all keypoints this near explain them equally, unit frame: files round."""
AS_WELL, TIE = 3.0, 1.5
"""A simpler mistake is preferred up to so many times worse; of equally simple ones, the one tried first."""
DOUBT = 3.0
"""So many times better must fit what has free numbers, or is two mistakes at once: such fits by chance, too."""
FEW = 6  # of a kind of mistake are measured exactly


@dataclass(frozen=True)
class Cause:
    words: str
    distance: float
    """Of the farthest keypoint, once undone; unit frame."""
    single: bool
    """One mistake without a free number: it hardly fits by chance, as an offset, or two mistakes, can."""
    reach: float = 1.0
    """Longest side of the keypoints' box, once undone, of at most 1; unit frame."""

    @property
    def misfit(self) -> float:
        """Distance for reach: drawn together, keypoints are near any surface."""
        return max(self.distance, FLOOR) / self.reach

    @property
    def doubt(self) -> float:
        return self.misfit * (1.0 if self.single else DOUBT)


def cause(positions: npt.NDArray[np.float64], shape: NormalizedShape, surface: npt.NDArray[np.float64]) -> Cause | None:
    """The mistake that explains the keypoints' positions (k, 3), source frame, best; of those that do about as well,
    the simplest. None where none does, or there are too few to tell.

    surface: (n, 3) places on the shape, dense, unit frame.
    """
    if len(positions) < 3:
        return None
    tree = cKDTree(surface)
    units, frames = list(_units()), list(_frames(shape))
    kinds: list[tuple[Iterable[Mistake], bool]] = [
        (units, True), (_turns(), True), (frames, True),
        (_ratios(positions, shape), False), (_both(units), False), (_both(frames), False),
    ]  # fmt: skip
    near = [_near(tried, positions, shape, tree) for tried, _ in kinds]
    exactly = iter(_distances(near, shape))
    found = [
        _first([Cause(one.words, next(exactly), single, one.reach) for one in some])
        for some, (_, single) in zip(near, kinds, strict=True)
    ]
    if _reach(shape.to_unit(positions)) >= SPREAD:
        found.append(_offset(positions, shape, tree))
    fitting = [one for one in found if one is not None and one.distance <= FITS]
    least = min((one.doubt for one in fitting), default=0.0)
    return next((one for one in fitting if one.doubt <= AS_WELL * least), None)


Undo = Callable[[np.ndarray], np.ndarray]
"""Positions (k, 3) as they were annotated → as they would be without the mistake, source frame."""
Mistake = tuple[str, Undo]


def _times(factor: float) -> Undo:
    return lambda p: p * factor


def _reordered(order: tuple[int, ...], sign: tuple[int, ...]) -> Undo:
    return lambda p: p[:, list(order)] * np.array(sign)


def _then(first: Undo, second: Undo) -> Undo:
    return lambda p: second(first(p))


@dataclass(frozen=True)
class _Undone:
    words: str
    unit: np.ndarray
    reach: float
    distance: float


def _near(tried: Iterable[Mistake], positions: np.ndarray, shape: NormalizedShape, tree: cKDTree) -> list[_Undone]:
    """Those that bring the keypoints near the surface, in the order tried; of many the `FEW` that do it best."""
    found = []
    for words, undo in tried:
        unit = shape.to_unit(undo(positions))
        if SPREAD <= (reach := _reach(unit)) < np.inf and (distance := float(tree.query(unit)[0].max())) <= FITS:
            found.append(_Undone(words, unit, min(reach, 1.0), distance))
    best = sorted(range(len(found)), key=lambda i: found[i].distance / found[i].reach)[:FEW]
    return [found[i] for i in sorted(best)]


def _distances(near: list[list[_Undone]], shape: NormalizedShape) -> list[float]:
    """Of the farthest keypoint of each, one kind after another: from the faces, where there are some."""
    every = [one for some in near for one in some]
    if not every or not len(shape.faces):
        return [one.distance for one in every]
    from b23d.stages.geometry.nearest import nearest_on_faces

    places = np.concatenate([one.unit for one in every])
    exact = nearest_on_faces(places, shape.vertices.astype(np.float64), shape.faces)[1]
    farthest = exact.reshape(len(every), -1).max(axis=1)
    return [min(float(far), one.distance) for far, one in zip(farthest, every, strict=True)]


def _first(found: list[Cause]) -> Cause | None:
    """Of about equally good ones the first."""
    least = min((one.misfit for one in found), default=0.0)
    return next((one for one in found if one.misfit <= TIE * least), None)


def _reach(unit: np.ndarray) -> float:
    return float(np.ptp(unit, axis=0).max()) if np.isfinite(unit).all() else np.inf


def _units() -> Iterator[Mistake]:
    for factor, units in UNITS.items():
        yield f"scaled ×{factor:.4g} ({units})", _times(1 / factor)
        one, _, other = units.partition(" for ")
        yield f"scaled ×{1 / factor:.4g} ({other} for {one})", _times(factor)
    for factor in (1e4, 1e5, 1e6):
        yield f"scaled ×{factor:.4g}", _times(1 / factor)
        yield f"scaled ×{1 / factor:.4g}", _times(factor)


def _turns() -> Iterator[Mistake]:
    """Axes in another order or direction: up mixed up, as converters do it; then the fewest changes of direction first.

    Of shapes that are their own mirror images, several fit.
    """
    for up, words in UP.items():
        yield f"axes in another order, {words}: {_right((0, 2, 1), up)}", _reordered((0, 2, 1), up)
    signs = sorted(product((1, -1), repeat=3), key=lambda s: s.count(-1))
    for sign, order in product(signs, permutations(range(3))):
        if (order == (0, 1, 2) and sign == (1, 1, 1)) or (order == (0, 2, 1) and sign in UP):
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
    return f"axes in another order: {_right(order, sign)}"


def _right(order: tuple[int, ...], sign: tuple[int, ...]) -> str:
    read = ", ".join(f"{'-' if s < 0 else ''}{'xyz'[axis]}" for axis, s in zip(order, sign, strict=True))
    return f"right as ({read})"


def _frames(shape: NormalizedShape) -> Iterator[Mistake]:
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


def _both(first: list[Mistake]) -> Iterator[Mistake]:
    for (words, undo), (axes, turn) in product(first, list(_turns())):
        yield f"{words}, and {axes}", _then(turn, undo)


def _ratios(positions: np.ndarray, shape: NormalizedShape) -> Iterator[Mistake]:
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
    return Cause(f"offset by ({x:g}, {y:g}, {z:g})", best[0], False, min(_reach(unit), 1.0))
