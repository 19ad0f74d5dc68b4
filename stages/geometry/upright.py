"""Which axis of a shape's file probably points up: a guess from flat undersides, for people to check."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from b23d.schemas.up_axis import UP_AXES, UpAxis, to_y_up

LEVEL = 0.97
"""Cosine between a face's normal and the axis from which it counts as level (14°)."""
REACH = 0.02
"""A face stands on the ground if it lies within this part of the extent from the lowest place."""
CLEAR = 2.0
"""The best axis must have this many times the next one's support; so must one end's footprint the other's."""
LEAST = 0.02
"""Least share of its box's floor that a shape must stand on."""
MIXED = 0.25
"""Share of the shapes looked at, and at least two, that must stand on a second axis for a class to look mixed."""


@dataclass(frozen=True)
class Stance:
    """How one shape seems to stand."""

    axis: UpAxis
    signed: bool
    """One end's footprint is the ground by far; else which end is up the shape does not tell, and `axis` is its
    positive."""

    def seen_in(self, rotation: np.ndarray) -> Stance:
        """The same in a frame whose directions are `rotation` (3, 3) @ this one's."""
        along = rotation @ to_y_up(self.axis)[1]
        axis = max(UP_AXES, key=lambda axis: float(to_y_up(axis)[1] @ along))
        return Stance(axis if self.signed else _axis(axis[-1]), self.signed)


@dataclass(frozen=True)
class Upright:
    """The guess for a set of shapes."""

    axis: UpAxis | None
    """None where the shapes do not tell, or not the same."""
    votes: int
    """Shapes that say so."""
    asked: int
    mixed: tuple[tuple[UpAxis, int], ...] = ()
    """Where the shapes stand on several axes: these, and how many on each, most first."""


def stance(vertices: np.ndarray, faces: np.ndarray) -> Stance | None:
    """How a mesh stands, vertices (v, 3) float, faces (f, 3) int; None where it does not tell."""
    found = support(vertices, faces)
    order = np.argsort(found)
    if not (found[order[-1]] > LEAST and found[order[-1]] > CLEAR * found[order[-2]]):
        return None
    axis = int(order[-1])
    low, high = _footprints(vertices[np.unique(faces)].astype(np.float64), axis)
    signed = max(low, high) > CLEAR * min(low, high)
    return Stance(_axis(("-" if signed and high > low else "") + "xyz"[axis]), signed)


def support(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(3,) for each axis, how much of its box's cross-section level faces at either end fill, 0 … 1 or a little more.

    vertices (v, 3) float, faces (f, 3) int. A table or a mug stands on one end, and has level faces there.
    """
    corners = vertices[faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1) / 2
    sound = np.isfinite(area) & (area > 0)
    corners, normals, area = corners[sound], normals[sound], area[sound]
    if not len(area):
        return np.zeros(3)
    low, high = corners.min((0, 1)), corners.max((0, 1))
    extent = np.maximum(high - low, np.finfo(float).tiny)
    level = np.abs(normals) / (2 * area[:, None]) > LEVEL
    centroids = corners.mean(axis=1)
    found = np.zeros(3)
    for axis in range(3):
        section = np.prod(np.delete(extent, axis))
        for end in (centroids[:, axis] - low[axis], high[axis] - centroids[:, axis]):
            there = level[:, axis] & (end < REACH * extent[axis])
            found[axis] = max(found[axis], area[there].sum() / section)
    return found


def guess(stances: Sequence[Stance | None]) -> Upright:
    """The axis that most of the shapes stand on, if more than half of them say so and not too many say another.

    Its positive end is up, unless more than half of the shapes clearly stand the other way round: a table on one leg
    does not tell.
    """
    told = [each for each in stances if each is not None]
    many = max(2.0, MIXED * len(stances))
    counts = Counter(each.axis[-1] for each in told)
    letters = sorted(counts.items(), key=lambda each: (-each[1], each[0]))  # the same in any order of the shapes
    if len(letters) > 1 and letters[1][1] >= many:
        return Upright(None, 0, len(stances), tuple((_axis(letter), count) for letter, count in letters))
    if not letters or letters[0][1] <= len(stances) / 2:
        return Upright(None, 0, len(stances))
    letter, votes = letters[0]
    ends = Counter(each.axis for each in told if each.signed and each.axis[-1] == letter)
    up, down = _axis(letter), _axis(f"-{letter}")
    if min(ends[up], ends[down]) >= many:
        return Upright(None, 0, len(stances), ((up, ends[up]), (down, ends[down])))
    return Upright(down if ends[down] > len(stances) / 2 else up, votes, len(stances))


def _axis(name: str) -> UpAxis:
    return next(axis for axis in UP_AXES if axis == name)


def _footprints(points: np.ndarray, axis: int) -> tuple[float, float]:
    """Areas of the convex hulls of what lies at the lower and at the upper end, over the cross-section."""
    low, high = points[:, axis].min(), points[:, axis].max()
    reach = REACH * (high - low)
    flat = np.delete(points, axis, axis=1)
    section = float(np.prod(np.maximum(np.ptp(flat, axis=0), np.finfo(float).tiny)))
    ends = points[:, axis] < low + reach, points[:, axis] > high - reach
    lower, upper = (_hull_area(flat[end]) / section for end in ends)
    return lower, upper


def _hull_area(points: np.ndarray) -> float:
    """Of points (n, 2); 0 where they are on a line."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return float(ConvexHull(points).volume) if len(points) > 2 else 0.0
    except QhullError:
        return 0.0
