"""Chairs: a seat, a back, what it stands on, and arms or none. Built in metres; the front is at -z."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.stages.datasets.procedural.assembling import Assembly, BuiltShape
from b23d.stages.datasets.procedural.bases import four_legs, pedestal
from b23d.stages.datasets.procedural.drawing import Chance
from b23d.stages.datasets.procedural.forms import at, box, plate, post, post_solid, slab, upright
from b23d.stages.datasets.procedural.solids import Place, Solid, refined, tube

KEYPOINTS = (
    "left_back_top", "right_back_top", "left_seat_back", "right_seat_back", "left_seat_front", "right_seat_front",
    "left_arm_front", "right_arm_front", "left_front_foot", "right_front_foot", "left_back_foot", "right_back_foot",
    "column_bottom", "back_foot",
)  # fmt: skip
PARTS = ("seat", "back", "leg", "arm")
COLORS = (
    {"seat": "#c98b55", "back": "#b87840", "leg": "#9a6236", "arm": "#a86d3b"},
    {"seat": "#5d7f95", "back": "#52738a", "leg": "#c9a577", "arm": "#bf9a6b"},
    {"seat": "#c65f4e", "back": "#b95445", "leg": "#4d4a4a", "arm": "#5a5656"},
    {"seat": "#e2d6c0", "back": "#d9cbb2", "leg": "#7c563c", "arm": "#8a6247"},
    {"seat": "#6f8f72", "back": "#648467", "leg": "#d6c7ae", "arm": "#cbbba0"},
    {"seat": "#3f4650", "back": "#474f5a", "leg": "#a9adb2", "arm": "#2f343b"},
)
STEP = 0.045
"""Longest side of a cell."""


@dataclass(frozen=True)
class Proportions:
    """Proportions that the parts of one chair share. Metres."""

    half_width: float
    half_depth: float
    thickness: float
    height: float
    """Of the seat's upper side."""
    round_front: float
    round_back: float
    taper: float
    back_half_width: float
    back_height: float
    """Above the seat."""
    back_z: float
    lean: float
    bend: float

    def leaning(self, points: np.ndarray) -> np.ndarray:
        """From the upright back's frame (y above the seat, z from the back's middle) to the chair's."""
        x, y, z = points.T
        back = self.back_z + z + self.lean * np.maximum(y, 0.0) - self.bend * (x / self.back_half_width) ** 2
        return np.stack([x, y + self.height, back], -1)


def chair(draw: Chance) -> BuiltShape:
    """One chair."""
    base = draw.pick({"four legs": 0.5, "star": 0.2, "disc": 0.1, "sled": 0.2})
    back = draw.pick({"solid": 0.24, "slats": 0.2, "ladder": 0.16, "rounded": 0.16, "hoop": 0.1, "low": 0.14})
    seat = draw.pick({"flat": 0.3, "cushion": 0.35, "tapered": 0.15, "round": 0.2})
    if base == "sled" and seat == "round":
        seat = "cushion"
    frame = _frame(draw, back, seat)
    arms = draw.pick({"none": 0.5, "rest": 0.35, "panel": 0.15})
    if back == "low" or seat == "round":
        arms = "none"
    style = {"base": base, "back": back, "seat": seat, "arms": arms}
    shape = Assembly(KEYPOINTS, PARTS, COLORS[draw.whole(0, len(COLORS) - 1)], style)
    outline = _seat(shape, draw, frame, cushion=seat == "cushion")
    _back(shape, draw, frame, back)
    _base(shape, draw, frame, base, outline)
    if arms != "none":
        _arms(shape, draw, frame, at(outline, 1, 1, -1)[2] + 0.025, panel=arms == "panel")
    return shape.finished(draw.between(0.9, 1.1))


def _frame(draw: Chance, back: str, seat: str) -> Proportions:
    half_width, half_depth = draw.between(0.2, 0.28), draw.between(0.2, 0.26)
    height = draw.between(0.4, 0.5)
    back_height = draw.between(0.34, 0.62)
    if back == "low":
        height, back_height = draw.between(0.55, 0.72), draw.between(0.14, 0.22)
        half_width, half_depth = half_width * 0.85, half_depth * 0.85
    round_front = {"flat": 0.0, "cushion": draw.between(0.05, 0.3), "tapered": 0.1, "round": 1.0}[seat]
    round_back = 1.0 if seat == "round" else round_front * draw.between(0.2, 1.0)
    taper = draw.between(0.08, 0.16) if seat == "tapered" else 0.0
    thickness = draw.between(0.05, 0.1) if seat == "cushion" else draw.between(0.022, 0.04)
    bend = draw.between(0.0, 0.06) + (0.04 if back in ("rounded", "hoop") else 0.0)
    corner = half_width * (1 - taper) * np.sqrt(1 - round_back / 2)
    back_half_width = corner * draw.between(0.86, 0.95)  # beside it the seat's corner stays in sight
    back_z = half_depth * 0.93 - 0.02
    if seat == "round":  # the back follows the seat's edge
        share = 0.68
        back_half_width, bend = half_width * share, half_depth * (1 - np.sqrt(1 - share**2)) * 0.95
    return Proportions(
        half_width, half_depth, thickness, height, round_front, round_back, taper,
        back_half_width, back_height, back_z, draw.between(0.04, 0.26), bend,
    )  # fmt: skip


def _seat(shape: Assembly, draw: Chance, f: Proportions, cushion: bool) -> Place:
    edge = f.thickness * (0.4 if cushion else 0.12)
    dome = draw.between(0.005, 0.025) if cushion else 0.0
    level = plate((f.half_width, f.thickness / 2, f.half_depth), f.round_front, f.round_back, edge, f.taper, dome)

    def place(lattice: np.ndarray) -> np.ndarray:
        return level(lattice) + np.array([0.0, f.height - f.thickness / 2, 0.0])

    shape.add("seat", slab(place, (2 * f.half_width, f.thickness, 2 * f.half_depth), STEP, rounded_edges=True))
    upper = 0.5 if cushion else 1  # a cushion's corner is where its upper edge has turned outwards
    shape.mark_pair("seat_back", at(place, 1, upper, 1))
    shape.mark_pair("seat_front", at(place, 1, upper, -1))
    return place


def _back(shape: Assembly, draw: Chance, f: Proportions, kind: str) -> None:
    wide, high = f.back_half_width, f.back_height
    thick = draw.between(0.022, 0.04)
    if kind in ("solid", "rounded", "low"):
        panelled = kind == "solid" and draw.chance(0.5)
        low = -f.thickness / 2
        if panelled or kind == "low":  # below the arms, so that they end in the panel
            low = min(0.15, high * draw.between(0.25, 0.4))
        thick *= draw.between(1.0, 1.8)
        top = {"solid": draw.between(0.0, 0.3), "rounded": 1.0, "low": draw.between(0.2, 0.8)}[kind]
        _panel(shape, f, low, top, thick)
        if low > 0:
            _posts(shape, f, wide * draw.between(0.5, 0.8), low + (high - low) * 0.3, thick * 0.3)
    elif kind == "hoop":
        _hoop(shape, draw, f, 0.013)
    else:
        _posts(shape, f, wide - thick / 2, high - thick, thick / 2)
        rail = draw.between(0.05, 0.11)
        _rail(shape, f, high - rail, high, wide, thick * 1.2, mark=True)
        if kind == "ladder":
            count = draw.whole(2, 4)
            gap = (high - rail) / count
            for k in range(count):
                _rail(
                    shape,
                    f,
                    gap * (k + 0.35),
                    gap * (k + 0.35) + min(rail, 0.42 * gap),
                    wide - thick * 0.6,
                    thick * 0.6,
                )
        else:
            lower = draw.between(0.06, 0.12)
            _rail(shape, f, lower, lower + 0.03, wide - thick * 0.6, thick * 0.8)
            _spindles(
                shape, f, draw.whole(2, 4), wide - thick, lower + 0.01, high - rail / 2, thick * draw.between(0.2, 0.35)
            )


def _panel(shape: Assembly, f: Proportions, low: float, round_top: float, thick: float) -> None:
    half = (f.back_half_width, thick / 2, (f.back_height - low) / 2)
    standing = upright(plate(half, back=round_top, edge=thick * 0.35))

    def place(lattice: np.ndarray) -> np.ndarray:
        return f.leaning(standing(lattice) + np.array([0.0, (f.back_height + low) / 2, 0.0]))

    shape.add("back", slab(place, (2 * half[0], 2 * half[2], thick), STEP, rounded_edges=True))
    shape.mark_pair("back_top", at(place, 1, 1, 0))


def _posts(shape: Assembly, f: Proportions, x: float, high: float, half: float) -> None:
    upright_post = post(
        np.array([x, high, 0.0]), np.array([x, -f.thickness * 0.7, 0.0]), (half, half), (half, half), False
    )
    shape.add_pair("back", post_solid(upright_post, high, STEP, False).placed(f.leaning))


def _rail(
    shape: Assembly, f: Proportions, low: float, high: float, wide: float, thick: float, mark: bool = False
) -> None:
    rail = upright(plate((wide, thick / 2, (high - low) / 2), back=0.15 * mark, edge=thick * 0.2))

    def place(lattice: np.ndarray) -> np.ndarray:
        return f.leaning(rail(lattice) + np.array([0.0, (high + low) / 2, 0.0]))

    shape.add("back", slab(place, (2 * wide, high - low, thick), STEP, rounded_edges=True))
    if mark:
        shape.mark_pair("back_top", at(place, 1, 1, 0))


def _spindles(shape: Assembly, f: Proportions, pairs: int, wide: float, low: float, high: float, half: float) -> None:
    gap = wide / (pairs + 0.5)
    for k in range(pairs):
        x = (k + 0.5) * gap
        spindle = post(np.array([x, high, 0.0]), np.array([x, low, 0.0]), (half, half), (half, half), True)
        shape.add_pair("back", post_solid(spindle, high - low, STEP, True).placed(f.leaning))


def _hoop(shape: Assembly, draw: Chance, f: Proportions, radius: float) -> None:
    """A bent rod from seat to seat, with spindles that end in it (a Windsor chair's bow)."""
    wide, high = f.back_half_width, f.back_height
    turn = np.linspace(0.0, np.pi / 2, 13)
    straight = np.array([[wide, -f.thickness * 0.7, 0.0], [wide, high - wide, 0.0]])
    arch = np.stack([wide * np.cos(turn), high - wide + wide * np.sin(turn), 0.0 * turn], -1)[1:]
    arch[-1, 0] = 0.0
    right = np.concatenate([refined(straight, STEP), arch]) if high > wide else arch
    path = np.concatenate([right, right[-2::-1] * np.array([-1.0, 1.0, 1.0])])
    hoop: Solid = tube(path, np.array([0.0, 0.0, 1.0]), (radius, radius)).placed(f.leaning)
    shape.add("back", hoop)
    shape.mark_pair("back_top", hoop.farthest(x=1.0, y=1.0))
    pairs = draw.whole(2, 3)
    for k in range(pairs):
        x = wide * (k + 0.5) / (pairs + 0.3)
        top = np.array([x, high - wide + np.sqrt(wide**2 - x**2), 0.0])
        half = (radius * 0.55, radius * 0.55)
        spindle = post(top, np.array([x * 0.85, -f.thickness * 0.7, 0.0]), half, half, True)
        shape.add_pair("back", post_solid(spindle, top[1], STEP, True).placed(f.leaning))


def _base(shape: Assembly, draw: Chance, f: Proportions, kind: str, seat: Place) -> None:
    thick, under = draw.between(0.028, 0.045), f.height - f.thickness * 0.5
    if kind == "four legs":
        inset = 1 - draw.between(0.7, 1.6) * thick / f.half_width
        front, back = at(seat, 1, 0, -1) * inset, at(seat, 1, 0, 1) * inset
        four_legs(shape, draw, "leg", (front[0], front[2]), (back[0], back[2]), under, thick, STEP)
    elif kind == "sled":
        _sled(shape, draw, f, under, cantilever=draw.chance(0.5))
    else:
        star = draw.pick({"five star": 0.65, "four star": 0.35}) if kind == "star" else "disc"
        shape.style["base"] = star
        reach = min(f.half_width, f.half_depth) * draw.between(1.0, 1.25)
        pedestal(shape, draw, "leg", star, reach, under, draw.between(0.05, 0.075), STEP)


def _sled(shape: Assembly, draw: Chance, f: Proportions, under: float, cantilever: bool) -> None:
    """A rod at either side: down at the front, back along the ground, and up again, or not (a cantilever)."""
    shape.style["base"] = "cantilever" if cantilever else "sled"
    radius, x = draw.between(0.011, 0.016), f.half_width * (1 - f.taper) * 0.86
    z, bow = f.half_depth * 0.84, 0.06
    turn = np.linspace(0.0, np.pi / 2, 6)

    def corner(z_center: float, y_center: float, first: float) -> np.ndarray:
        return np.stack([0.0 * turn, y_center + bow * np.sin(turn + first), z_center + bow * np.cos(turn + first)], -1)

    ground, high = radius + bow, under - radius
    front = corner(-z + bow, ground, np.pi)  # angles run from z towards y
    upper = corner(-z + bow, high - bow, np.pi / 2)
    rear = corner(z - bow, ground, 1.5 * np.pi) if not cantilever else np.array([[0.0, radius, z]])
    end = np.array([[0.0, under, z]]) if not cantilever else np.empty((0, 3))
    path = np.concatenate([[[0.0, high, z * 0.7]], upper, front, rear, end])
    runner = tube(refined(path, STEP), np.array([1.0, 0.0, 0.0]), (radius, radius)).moved(x=x)
    shape.add_pair("leg", runner)
    shape.add("leg", box((-x, high - radius * 0.6, -0.01), (x, high + radius * 0.6, 0.01), STEP))
    shape.mark_pair("front_foot", runner.farthest(x=0.1, y=-1.0, z=-0.6))
    shape.mark_pair("back_foot", runner.farthest(x=0.1, y=-1.0, z=0.6))


def _arms(shape: Assembly, draw: Chance, f: Proportions, foremost: float, panel: bool) -> None:
    """Arms that begin behind z = `foremost`, so that they hide no corner of the seat, and end in the back."""
    above, thick = draw.between(0.17, 0.24), draw.between(0.022, 0.035)
    wide = draw.between(0.04, 0.06) if not panel else draw.between(0.05, 0.09)
    x = f.back_half_width - 0.2 * wide
    z_back = float(f.leaning(np.array([[x, above, 0.0]]))[0, 2])
    z_front = max(foremost, -f.half_depth * draw.between(0.55, 0.92))
    top = f.height + above

    low = f.height - f.thickness * 0.5 if panel else top - thick
    rest = plate(
        (wide / 2, (top - low) / 2, (z_back - z_front) / 2), front=0.0 if panel else 0.4, edge=0.3 * min(wide, thick)
    )

    def place(lattice: np.ndarray) -> np.ndarray:
        return rest(lattice) + np.array([x, (top + low) / 2, (z_back + z_front) / 2])

    shape.add_pair("arm", slab(place, (wide, top - low, z_back - z_front), STEP, rounded_edges=not panel))
    shape.mark_pair("arm_front", at(place, 0, 1, -1))
    if not panel:
        half, z = thick * 0.45, z_front + draw.between(0.03, 0.08)
        support = post(
            np.array([x, top - thick / 2, z]),
            np.array([x, f.height - f.thickness / 2, z]),
            (half, half),
            (half, half),
            False,
        )
        shape.add_pair("arm", post_solid(support, above, STEP, False))
