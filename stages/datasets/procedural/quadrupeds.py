"""Quadrupeds of five families: horses, dogs, cattle, goats, cats.

Built in trunk lengths, hooves on y = 0; the head is at -z. Front and back differ, and left and right are mirror images.
Every shape has the same rings, so that vertex i is the same place on every shape that has the same horns.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from b23d.stages.datasets.procedural.assembling import Assembly, BuiltShape
from b23d.stages.datasets.procedural.drawing import Chance
from b23d.stages.datasets.procedural.quadruped_families import FAMILIES, AnimalFamily
from b23d.stages.datasets.procedural.solids import Solid, circle, loft
from b23d.stages.datasets.procedural.trunks import AROUND, Trunk

KEYPOINTS = (
    "nose", "poll", "withers", "rump", "chest", "tail_tip", "left_ear_tip", "right_ear_tip", "left_horn_tip",
    "right_horn_tip", "left_front_foot", "right_front_foot", "left_back_foot", "right_back_foot", "left_back_hock",
    "right_back_hock",
)  # fmt: skip
PARTS = ("body", "head", "leg", "tail")
TRIM = {"horn": "#d8cdb4", "hoof": "#3d3833", "muzzle": "#4a3f3a"}
COLORS = (
    {"body": "#8a5a36", "head": "#7d5030", "leg": "#6b4529", "tail": "#2f2622"},
    {"body": "#c9a777", "head": "#c09c6a", "leg": "#e6d9c2", "tail": "#b08c5c"},
    {"body": "#e4ddd0", "head": "#d8cfbf", "leg": "#cfc5b3", "tail": "#f0ebe1"},
    {"body": "#4b4440", "head": "#3f3936", "leg": "#8d7a66", "tail": "#37312e"},
    {"body": "#a9683f", "head": "#ece2d2", "leg": "#ece2d2", "tail": "#a9683f"},
    {"body": "#8f9396", "head": "#7f8387", "leg": "#6d7174", "tail": "#a5a9ac"},
)
SIDES = 16


@dataclass(frozen=True)
class Posture:
    """Degrees by which a pose differs from standing at ease."""

    neck: float = 0.0
    """Lowered."""
    head: float = 0.0
    """Nodded further."""
    front: tuple[float, float] = (0.0, 0.0)
    """Right and left front leg swung to the front, from the elbow."""
    back: tuple[float, float] = (0.0, 0.0)
    """Right and left back leg, from the hip."""


AT_EASE = Posture()
GRAZING = Posture(neck=75.0, head=12.0, front=(14.0, -12.0), back=(-12.0, 10.0))
"""A step, with the head at the ground."""


def quadruped(draw: Chance, posture: Posture = AT_EASE) -> BuiltShape:
    """One quadruped. Vertex i is the same place of the body in every posture."""
    name = draw.pick({"horse": 0.25, "dog": 0.25, "cattle": 0.2, "goat": 0.15, "cat": 0.15})
    family = FAMILIES[name]
    shape = Assembly(KEYPOINTS, PARTS, COLORS[draw.whole(0, len(COLORS) - 1)] | TRIM, {"family": name})
    build = draw.pick({"slim": 0.35, "stout": 0.65})
    shape.style["build"] = build
    girth = 0.85 if build == "slim" else 1.05
    trunk = Trunk(
        draw.between(*family.leg), draw.between(*family.depth) * girth, draw.between(*family.width) * girth,
        draw.between(*family.tuck), draw.between(-0.03, 0.04), draw.between(0.0, 0.03),
    )  # fmt: skip
    shape.add("body", trunk.solid())
    _marks(shape, trunk)
    _head(shape, draw, family, trunk, posture)
    _legs(shape, draw, trunk, posture)
    _tail(shape, draw, family, trunk)
    return shape.finished(draw.between(0.9, 1.1))


def _marks(shape: Assembly, trunk: Trunk) -> None:
    solid, at = trunk.solid(), trunk.stations()
    ridge, keel = (solid.vertices[start : AROUND * len(at) : AROUND] for start in (0, AROUND // 2))
    shape.mark("chest", keel[int(np.abs(at - 0.05).argmin())])
    shape.mark("withers", ridge[int(np.abs(at - 0.32).argmin())])
    shape.mark("rump", ridge[int(np.abs(at - 0.84).argmin())])


def _head(shape: Assembly, draw: Chance, family: AnimalFamily, trunk: Trunk, posture: Posture) -> None:
    """Neck, head, ears and horns."""
    rise, nod = np.radians(draw.between(*family.rise)), np.radians(draw.between(*family.nod))
    long, thick = draw.between(*family.neck), trunk.depth * draw.between(0.62, 0.75)
    size = draw.between(*family.head)
    rise, nod = rise - np.radians(posture.neck), nod + np.radians(posture.head)
    root = np.array([0.0, float(trunk.top(0.14)) - 0.62 * trunk.depth, -0.36])
    share = np.linspace(0.0, 1.0, 10)[:, None]
    along, arch = _heading(rise), _heading(rise + np.pi / 2)
    path = root + (long + 0.2) * share * along + 0.1 * long * np.sin(np.pi * share) * arch
    narrow = np.interp(share[:, 0], [0, 1], [1.0, 0.58])
    shape.add("body", swept(path, 0.72 * thick * narrow, thick * narrow))
    maned = draw.chance(family.mane)
    shape.style["mane"] = "upright" if maned else "none"
    if maned:
        crest = path[2:] + 0.95 * thick * narrow[2:, None] * arch
        tall = thick * np.array([0.12, 0.3, 0.38, 0.4, 0.38, 0.32, 0.24, 0.12])
        shape.add("body", swept(crest, 0.25 * tall, tall), tint="tail")
    poll, forward = path[-1] + 0.12 * size * arch, _heading(-nod)
    up, skull = _heading(np.pi / 2 - nod), 0.23 * size
    share = np.linspace(0.0, 1.0, 16)
    outline = np.interp(share, [0, 0.06, 0.2, 0.42, 0.62, 0.85, 0.95, 1], [0.35, 0.75, 1.0, 1.0, 0.72, 0.6, 0.5, 0.28])
    sink = np.interp(share, [0, 0.3, 0.6, 1], [0.0, 0.0, -0.18, -0.3])
    line = poll - 0.18 * size * forward + share[:, None] * size * forward + skull * sink[:, None] * up
    head = swept(line, skull * draw.between(0.72, 0.95) * outline, skull * outline)
    shape.add("head", head)
    shape.mark("nose", head.vertices[-1])
    ridge = head.vertices[: SIDES * len(line)].reshape(len(line), SIDES, 3)
    crown = int(np.abs(share - 0.2).argmin())
    shape.mark("poll", max(ridge[crown, 0], ridge[crown, SIDES // 2], key=lambda place: float(place @ up)))
    side = np.array([1.0, 0.0, 0.0])
    base = line[2] + skull * (0.5 * side + 0.55 * up)
    flop = draw.chance(family.flop)
    shape.style["ears"] = "hanging" if flop else "upright"
    ear = size * draw.between(0.26, 0.4)
    lean = (0.95 * side - 0.75 * up) if flop else (0.45 * side + 0.85 * up)
    share = np.linspace(0.0, 1.0, 6)
    bow = 0.35 * np.sin(np.pi * share[:, None]) * (side if flop else -forward)
    path = base + ear * (share[:, None] * lean + bow)
    leaf = ear * np.array([0.22, 0.36, 0.4, 0.34, 0.22, 0.06])
    _pair(shape, "head", "ear_tip", swept(path, leaf, 0.4 * leaf, "along"))
    horned = draw.chance(family.horns)
    kind = draw.pick({"curved": 0.6, "straight": 0.4})
    shape.style["horns"] = kind if horned else "none"
    reach = size * draw.between(0.35, 0.8)
    if horned:
        base = line[3] + skull * (0.4 * side + 0.8 * up)
        out = side * (0.9 if kind == "curved" else 0.35)
        bow = 0.4 * np.sin(0.8 * np.pi * share[:, None]) * out
        path = base + reach * (share[:, None] * (0.75 * up + 0.3 * out) + bow)
        stem = 0.13 * reach * np.array([1.0, 0.95, 0.8, 0.6, 0.38, 0.12]) + 0.004
        _pair(shape, "head", "horn_tip", swept(path, stem, stem, "along"), "horn")


def _legs(shape: Assembly, draw: Chance, trunk: Trunk, posture: Posture) -> None:
    thick, foot = draw.between(0.045, 0.062), draw.between(0.05, 0.075)
    hock = draw.between(0.06, 0.1)
    for which, at, forward in (("front", 0.2, posture.front), ("back", 0.86, posture.back)):
        x, top = 0.62 * float(trunk.half_width(at)), float(trunk.middle(at))
        bend = (0.02, -0.012) if which == "front" else (-0.07, hock)
        z = at - 0.5
        joints = np.array([[x, top, z], [x, 0.62 * trunk.leg, z + bend[0]], [x, 0.34 * trunk.leg, z + bend[1]],
                           [x, 0.055, z + 0.5 * bend[1]], [x, 0.03, z + 0.5 * bend[1] - 0.3 * foot]])  # fmt: skip
        girth = thick * np.array([1.9 if which == "back" else 1.5, 1.15, 0.72, 0.6, 0.66])
        for right, angle in zip((True, False), forward, strict=True):
            _leg(shape, which, _swung(joints, angle), girth, foot, right)


def _leg(shape: Assembly, which: str, joints: np.ndarray, girth: np.ndarray, foot: float, right: bool) -> None:
    """A leg through joints (5, 3) of the right one, or its image, with its hoof; `girth` (5,): radii there."""
    corners = np.arange(len(joints))
    share = np.linspace(0, len(joints) - 1, 21)
    path = np.stack([np.interp(share, corners, joints[:, axis]) for axis in range(3)], -1)
    path[1:-1] = (path[:-2] + 2 * path[1:-1] + path[2:]) / 4
    radius = np.interp(share, corners, girth) * np.sqrt(1 - np.clip(1 - (share + 0.03) / 0.7, 0.0, 1.0) ** 2)
    leg = swept(path, 0.85 * radius, radius, "along")
    end = joints[-1]
    size = np.array([0.8, 1.0, 1.0, 0.85]) * foot * 0.5
    sole = end + np.array([0.0, 1.0, 0.0]) * np.array([0.028, 0.005, -0.02, -0.029])[:, None]
    hoof = swept(sole - np.array([0.0, 0.0, 0.12 * foot]), size, 1.3 * size, "along")
    bend = leg.vertices[10 * SIDES : 11 * SIDES]
    marks = {f"{which}_foot": hoof.farthest(z=-1.0)}
    if which == "back":
        marks["back_hock"] = bend[bend[:, 2].argmax()]
    for name, place in marks.items():
        if right:
            shape.mark_at(f"right_{name}", place)
        else:
            shape.mark_at(f"left_{name}", place * np.array([-1.0, 1.0, 1.0]))
    shape.add("leg", leg if right else leg.mirrored())
    shape.add("leg", hoof if right else hoof.mirrored(), tint="hoof")


def _tail(shape: Assembly, draw: Chance, family: AnimalFamily, trunk: Trunk) -> None:
    raised = draw.chance(family.raised)
    long, curl = draw.between(*family.tail), draw.between(0.2, 0.9)
    shape.style["tail"] = "raised" if raised else "hanging"
    root = np.array([0.0, float(trunk.top(0.95)) - 0.25 * trunk.depth, 0.44])
    share = np.linspace(0.0, 1.0, 12)
    angle = np.radians(20.0) + (share * curl if raised else -np.minimum(1.0, 3 * share) * np.radians(95.0))
    steps = long / 11 * np.stack([0 * angle, np.sin(angle), np.cos(angle)], -1)[1:]
    path = np.concatenate([root[None], root + np.cumsum(steps, axis=0)])
    thick = trunk.depth * draw.between(0.1, 0.17) * np.interp(share, [0, 0.2, 0.75, 1], [1.2, 0.9, 1.0, 0.3])
    tail = swept(path, thick, thick)
    shape.add("tail", tail)
    shape.mark("tail_tip", tail.vertices[-1])


def _pair(shape: Assembly, part: str, name: str, solid: Solid, tint: str = "") -> None:
    """A right solid and its image, whose ends are keypoints."""
    shape.add_pair(part, solid, tint=tint)
    shape.mark_pair(name, solid.vertices[-1])


def _heading(angle: float) -> np.ndarray:
    """(3,) in the plane x = 0, `angle` radians above straight ahead."""
    return np.array([0.0, np.sin(angle), -np.cos(angle)])


def _swung(joints: np.ndarray, degrees: float) -> np.ndarray:
    """Joints (m, 3) turned about the first, forwards below it."""
    angle, away = np.radians(degrees), joints - joints[0]
    y, z = away[:, 1], away[:, 2]
    turned = np.stack([away[:, 0], np.cos(angle) * y - np.sin(angle) * z, np.sin(angle) * y + np.cos(angle) * z], -1)
    return joints[0] + turned


def swept(path: np.ndarray, wide: np.ndarray, deep: np.ndarray, mirror: Literal["around", "along"] = "around") -> Solid:
    """A tube along path (m, 3) with half axes (m,) across, which is level, and upright to that. One along x = 0 is its
    own mirror image ("around"). The last vertex is the path's end."""
    forward = np.gradient(path, axis=0)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    side = np.array([1.0, 0.0, 0.0]) - forward[:, :1] * forward
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up, turn = np.cross(forward, side), circle(SIDES)
    around = wide[:, None, None] * turn[:, :1] * side[:, None] + deep[:, None, None] * turn[:, 1:] * up[:, None]
    return loft(path[:, None] + around, start=path[0], end=path[-1], mirror=mirror)
