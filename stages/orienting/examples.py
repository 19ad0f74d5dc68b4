"""How the annotated shapes of a class stand to each other, by their keypoints, and which of them says what is up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.schemas.shape import turned
from b23d.schemas.up_axis import UP_AXES, UpAxis, to_y_up
from b23d.stages.geometry.upright import Stance
from b23d.stages.orienting.looks import described, hypotheses, unlike

COMMON = 3
"""Keypoints that two shapes must share for these to say how they stand to each other; else their looks say it."""
TURNS = 24
SIGNED, UNSIGNED = 2.0, 1.0
"""What a flat underside counts for an axis, and for both its ends where it does not tell which is up."""
APART = 0.1
"""Standard deviation of a keypoint's place from shape to shape, in largest box sides: shapes that are turned about what
is up, each its own way, cannot be brought onto each other with another axis up."""
AS_IT_IS = 0.5
"""What it counts that a file's own +y is up, where nothing else tells."""


@dataclass(frozen=True)
class ExampleShape:
    """One annotated shape as its file stands, in its unit frame."""

    points: np.ndarray
    """(n, 3) float64, in farthest-point order."""
    ids: np.ndarray
    keypoints: np.ndarray
    """(k, 3) float64."""
    stance: Stance | None
    declared: UpAxis | None


@dataclass(frozen=True)
class Standing:
    """All examples of a class."""

    rotations: list[np.ndarray]
    """(3, 3) each: upright, and turned onto the reference."""
    axes: list[UpAxis]
    by: str
    """`declared`, `undersides` or `as they are`."""


def standing(examples: list[ExampleShape]) -> Standing:
    """Every example upright in one frame. Of all axes that the reference may have, the one that fits best what is
    declared, and else how well the others can be turned onto it and how they stand on flat undersides; at least one
    example."""
    middle = _middle(examples)
    best: tuple[tuple[float, float], Standing] | None = None
    for up in UP_AXES:
        upright = to_y_up(up)
        found = [_Onto(up, upright, 0.0)] * len(examples)
        for i, example in enumerate(examples):
            if i != middle:
                found[i] = _onto(example, examples[middle], upright)
        axes = [each.axis for each in found]
        apart = sum(each.apart for each in found) / (2 * APART**2)
        declared = sum(e.declared == axis for e, axis in zip(examples, axes, strict=True) if e.declared is not None)
        votes = sum(_vote(e.stance, axis) for e, axis in zip(examples, axes, strict=True))
        kept = AS_IT_IS * sum(axis == "y" for axis in axes)
        by = "declared" if declared else "undersides" if votes else "as they are"
        rank = (float(declared), votes + kept - apart)
        if best is None or rank > best[0]:
            best = rank, Standing([each.rotation for each in found], axes, by)
    assert best is not None
    return best[1]


def _middle(examples: list[ExampleShape]) -> int:
    """The example that shares most keypoints with the others."""
    shared = [sum(len(np.intersect1d(a.ids, b.ids)) for b in examples) for a in examples]
    return int(np.argmax(shared))


def _vote(stance: Stance | None, axis: UpAxis) -> float:
    if stance is None or stance.axis[-1] != axis[-1]:
        return 0.0
    return (SIGNED if stance.axis == axis else 0.0) if stance.signed else UNSIGNED


@dataclass(frozen=True)
class _Onto:
    """One example on another."""

    axis: UpAxis
    rotation: np.ndarray
    apart: float
    """Summed square distance of the keypoints that both have."""


def _onto(example: ExampleShape, reference: ExampleShape, upright: np.ndarray) -> _Onto:
    """The example on the reference, which `upright` (3, 3) sets upright: Procrustes among the six axes, each with its
    best turn."""
    _, own, other = np.intersect1d(example.ids, reference.ids, return_indices=True)
    if len(own) < COMMON:
        rotations = hypotheses(TURNS)
        off = unlike(example.points, [described(reference.points @ upright.T)], rotations)
        i, turn = np.unravel_index(int(off.argmin()), off.shape)
        return _Onto(UP_AXES[i], rotations[i, turn], 0.0)
    ours, theirs = example.keypoints[own], reference.keypoints[other] @ upright.T
    ours, theirs = ours - ours.mean(0), theirs - theirs.mean(0)
    found = []
    for axis in UP_AXES:
        rotation = to_y_up(axis)
        rotation = _turn_onto(ours @ rotation.T, theirs) @ rotation
        found.append(_Onto(axis, rotation, float(((ours @ rotation.T - theirs) ** 2).sum())))
    return min(found, key=lambda each: each.apart)


def _turn_onto(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(3, 3) the turn about +y that brings a (k, 3) nearest to b, both centred."""
    angle = np.arctan2((a[:, 2] * b[:, 0] - a[:, 0] * b[:, 2]).sum(), (a[:, [0, 2]] * b[:, [0, 2]]).sum())
    return turned(float(np.rad2deg(angle)))
