"""The rigid motions that annotated symmetries stand for: mirrors, and turns about the vertical (+y is up)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

Motion = Callable[[np.ndarray], np.ndarray]
"""(…, 3) float64 → (…, 3)."""


def mirror(a: np.ndarray, b: np.ndarray) -> Motion:
    """Reflection in the plane midway between points a and b, (3,) each."""
    normal = (a - b) / max(float(np.linalg.norm(a - b)), np.finfo(np.float64).tiny)
    middle = (a + b) / 2
    return lambda points: points - 2 * ((points - middle) @ normal)[..., None] * normal


def turn(tuples: list[np.ndarray]) -> Motion:
    """The turn about a vertical axis that takes each point of every tuple to the next, and the last to the first.

    tuples: (m, 3) float64 each, m alike: points in order around the axis, which passes through the median of the
    tuples' means, so that a wrong tuple does not move it. An m-th of a full turn, to whichever side fits better.
    """
    points = np.concatenate(tuples)
    following = np.concatenate([np.roll(ids, -1, axis=0) for ids in tuples])
    centre = np.median([ids.mean(0) for ids in tuples], axis=0)
    angle = 2 * np.pi / len(tuples[0])
    motions = [_about(centre, sign * angle) for sign in (1, -1)]
    return min(motions, key=lambda motion: float(((motion(points) - following) ** 2).sum()))


def half_turn(middle: np.ndarray) -> Motion:
    """The half turn about the vertical through (3,) middle: front and back are exchanged, and left and right."""
    return lambda points: np.stack(
        [2 * middle[0] - points[..., 0], points[..., 1], 2 * middle[2] - points[..., 2]], axis=-1
    )


def _about(centre: np.ndarray, angle: float) -> Motion:
    cos, sin = np.cos(angle), np.sin(angle)
    matrix = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])
    return lambda points: (points - centre) @ matrix.T + centre
