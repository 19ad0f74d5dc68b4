"""Figures: people of a few tubes, in any pose and build, whose vertices correspond.

Feet stand at y = 0 where legs are straight, the front is -z, the figure's own right +x. Standing figures are exactly
mirror symmetric.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.stages.datasets.procedural.solids import Solid, circle, loft

RINGS, SIDES = 28, 16


@dataclass(frozen=True)
class Physique:
    """Lengths in figure heights or so; the defaults are an adult's."""

    leg: float = 0.48
    arm: float = 0.36
    torso: float = 0.33
    shoulders: float = 0.12
    """From the middle to a shoulder."""
    hips: float = 0.055
    girth: float = 1.0
    """Multiplies how thick everything but the head is."""
    head: float = 0.075


@dataclass(frozen=True)
class LimbPose:
    """Degrees; 0 everywhere: the limb hangs down."""

    out: float = 0.0
    """Raised sideways."""
    forward: float = 0.0
    """Swung to the front."""
    bend: float = 0.0
    """At the elbow to the front, at the knee to the back."""


@dataclass(frozen=True)
class Pose:
    right_arm: LimbPose = LimbPose(out=25.0)
    left_arm: LimbPose = LimbPose(out=25.0)
    right_leg: LimbPose = LimbPose(out=4.0)
    left_leg: LimbPose = LimbPose(out=4.0)


STANDING = Pose()
WALKING = Pose(
    right_arm=LimbPose(out=12.0, forward=50.0, bend=50.0), left_arm=LimbPose(out=15.0, forward=-40.0, bend=20.0),
    right_leg=LimbPose(out=4.0, forward=-28.0, bend=35.0), left_leg=LimbPose(out=4.0, forward=38.0, bend=12.0),
)  # fmt: skip
WAVING = Pose(
    right_arm=LimbPose(out=130.0, bend=50.0), left_arm=LimbPose(out=40.0, forward=60.0, bend=70.0),
    right_leg=LimbPose(out=10.0), left_leg=LimbPose(out=16.0, forward=10.0),
)  # fmt: skip
CHILD = Physique(leg=0.4, arm=0.29, torso=0.34, shoulders=0.1, girth=1.15, head=0.11)


def figure(pose: Pose = STANDING, build: Physique = Physique()) -> Solid:
    """One figure. Vertex i is the same place of the body in every pose and build, and so is face i."""
    height, girth = build.leg, build.girth
    neck = height + build.torso
    torso = _torso(height, neck, build)
    head = _ball(np.array([0.0, neck + 0.9 * build.head + 0.02, -0.01]), build.head)
    right = [
        _limb(np.array([build.shoulders, neck - 0.03, 0.0]), build.arm, 0.028 * girth, pose.right_arm, 0.02, 1.0),
        _limb(np.array([build.hips, height + 0.01, 0.0]), height + 0.01, 0.05 * girth, pose.right_leg, 0.09, -1.0),
    ]
    left = [
        _limb(np.array([build.shoulders, neck - 0.03, 0.0]), build.arm, 0.028 * girth, pose.left_arm, 0.02, 1.0),
        _limb(np.array([build.hips, height + 0.01, 0.0]), height + 0.01, 0.05 * girth, pose.left_leg, 0.09, -1.0),
    ]
    return _together([torso, head, *right, *(solid.mirrored() for solid in left)])


def _torso(low: float, high: float, build: Physique) -> Solid:
    share = np.linspace(0.0, 1.0, RINGS)
    wide = np.interp(share, [0, 0.15, 0.45, 0.85, 0.95, 1], [0.06, 0.1, 0.085, 0.12, 0.08, 0.035]) * build.girth
    wide *= np.interp(share, [0, 0.6, 0.85, 1], [1, 1, build.shoulders / 0.12 / build.girth, 1])
    deep = np.interp(share, [0, 0.2, 0.45, 0.8, 1], [0.05, 0.068, 0.055, 0.065, 0.03]) * build.girth
    turn, height = circle(SIDES), low - 0.03 + (high - low + 0.05) * share
    rings = np.stack(
        [wide[:, None] * turn[:, 0], height[:, None] + 0 * turn[:, 0], deep[:, None] * turn[:, 1]], axis=-1
    )
    return loft(rings)


def _ball(middle: np.ndarray, radius: float) -> Solid:
    turn, angle = circle(SIDES), np.linspace(0.0, np.pi, 14)[1:-1]
    across, up = np.sin(angle), -np.cos(angle)
    rings = np.stack([
        0.8 * across[:, None] * turn[:, 0], 1.1 * up[:, None] + 0 * turn[:, 0], 0.95 * across[:, None] * turn[:, 1]
    ], axis=-1)  # fmt: skip
    return loft(middle + radius * rings)


def _limb(start: np.ndarray, length: float, radius: float, pose: LimbPose, end: float, fold: float) -> Solid:
    """A right arm or leg from `start` (3,): two bones, the joint bent smoothly, and a foot (or hand) `end` long."""
    out, forward = np.deg2rad(pose.out), np.deg2rad(pose.forward)
    turned = np.deg2rad(pose.forward + fold * pose.bend)
    joints = [start]
    for angle in (forward, turned):
        down = np.array([np.sin(out), -np.cos(out) * np.cos(angle), -np.cos(out) * np.sin(angle)])
        joints.append(joints[-1] + length / 2 * down)
    toe = np.array([0.0, -np.sin(turned), -np.cos(turned)])  # across the shin, to the front
    joints.append(joints[-1] + end * toe)
    path = _smooth(np.stack(joints), np.array([0.5, 0.5, end / length]))
    share = np.linspace(0.0, 1.0, len(path))
    thick = radius * np.interp(share, [0, 0.04, 0.25, 0.85, 0.96, 1], [0.6, 1.1, 1.0, 0.62, 0.6, 0.3])
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side, turn, rings = np.array([1.0, 0.0, 0.0]), circle(SIDES), []
    for middle, tangent, size in zip(path, along, thick, strict=True):
        side = side - (side @ tangent) * tangent  # carried along without a twist
        side /= np.linalg.norm(side)
        rings.append(middle + size * (turn[:, :1] * side + turn[:, 1:] * np.cross(tangent, side)))
    return loft(np.stack(rings), mirror="along")  # its ends need not lie in x = 0


def _smooth(joints: np.ndarray, bones: np.ndarray) -> np.ndarray:
    """(RINGS, 3) along the polyline of joints (4, 3), corners rounded; as many rings on each bone in every pose."""
    at = np.concatenate([[0.0], np.cumsum(bones / bones.sum())])
    dense = np.linspace(0.0, 1.0, 40 * RINGS)
    line = np.stack([np.interp(dense, at, joints[:, axis]) for axis in range(3)], axis=1)
    width = int(0.06 * len(dense))
    padded = np.concatenate([np.repeat(line[:1], width, 0), line, np.repeat(line[-1:], width, 0)])
    kernel = np.hanning(2 * width + 1)
    soft = np.stack([np.convolve(padded[:, axis], kernel / kernel.sum(), "valid") for axis in range(3)], axis=1)
    return soft[np.linspace(0, len(soft) - 1, RINGS).round().astype(int)]


def _together(solids: list[Solid]) -> Solid:
    offsets = np.cumsum([0, *(len(solid.vertices) for solid in solids)])
    faces = [solid.faces + at for solid, at in zip(solids, offsets[:-1], strict=True)]
    return Solid(np.concatenate([solid.vertices for solid in solids]), np.concatenate(faces))
