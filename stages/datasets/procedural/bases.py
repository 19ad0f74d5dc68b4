"""What chairs and tables stand on: four legs, or a column with a disc or a star of feet. All stand on y = 0.

Keypoints set here: `left_front_foot`, `right_front_foot`, `left_back_foot`, `right_back_foot` (the outermost point
where a leg, runner or star foot meets the ground), `back_foot` (the odd foot of a five-star), `column_bottom` (its
underside).
"""

from __future__ import annotations

import numpy as np

from b23d.stages.datasets.procedural.assembling import Assembly
from b23d.stages.datasets.procedural.drawing import Chance
from b23d.stages.datasets.procedural.forms import at, beam, beam_solid, box, post, post_solid
from b23d.stages.datasets.procedural.solids import refined, revolve


def four_legs(
    shape: Assembly,
    draw: Chance,
    part: str,
    front: tuple[float, float],
    back: tuple[float, float],
    height: float,
    thick: float,
    step: float,
) -> None:
    """Four legs whose tops are at (x, z) = `front` and `back` and the images of these. `thick`: width at the top.

    Draws the section, taper, splay and stretchers.
    """
    round_ = draw.chance(0.45)
    taper = draw.between(0.45, 1.0)
    splay = draw.pick({"straight": 0.55, "splayed": 0.45})
    lean = draw.between(0.05, 0.15) * height if splay == "splayed" else 0.0
    braces = draw.pick({"none": 0.5, "sides": 0.2, "h": 0.15, "ring": 0.15})
    shape.style |= {"legs": f"{'round' if round_ else 'square'} {splay}", "braces": braces}
    half = (thick / 2, thick / 2)
    foot = (thick / 2 * taper, thick / 2 * taper)
    middles = {}
    brace_height = draw.between(0.22, 0.5)
    for name, (x, z) in {"front": front, "back": back}.items():
        top = np.array([x, height, z])
        bottom = np.array([x + lean, 0.0, z + np.sign(z) * lean])
        leg = post(top, bottom, half, foot, round_)
        shape.add_pair(part, post_solid(leg, height, step, round_))
        shape.mark_pair(f"{name}_foot", at(leg, 1, -1, np.sign(z)))
        middles[name] = bottom + (top - bottom) * brace_height
    _braces(shape, part, braces, middles["front"], middles["back"], thick * 0.3 * (1 + taper), step)


def _braces(
    shape: Assembly, part: str, kind: str, front: np.ndarray, back: np.ndarray, size: float, step: float
) -> None:
    """Stretchers between legs whose axes pass through `front` and `back` at the right."""
    if kind == "none":
        return
    side = beam(front, back, (size, size), (size, size))
    shape.add_pair(part, beam_solid(side, float(np.linalg.norm(back - front)), step))
    if kind == "h":
        middle = (front + back) / 2
        shape.add(part, box(_low(middle, size), _high(middle, size), step))
    if kind == "ring":
        for end in (front, back):
            shape.add(part, box(_low(end, size), _high(end, size), step))


def _low(end: np.ndarray, size: float) -> tuple[float, float, float]:
    return -end[0], end[1] - 0.5 * size, end[2] - 0.5 * size


def _high(end: np.ndarray, size: float) -> tuple[float, float, float]:
    return end[0], end[1] + 0.5 * size, end[2] + 0.5 * size


def pedestal(
    shape: Assembly,
    draw: Chance,
    part: str,
    kind: str,
    reach: float,
    height: float,
    thick: float,
    step: float,
    turned: bool = False,
) -> None:
    """A column up to `height` with a base of radius `reach`; `kind`: "disc", "four star" or "five star".

    `thick`: the column's diameter. `turned`: the column swells and narrows, as from a lathe.
    """
    radius = thick / 2
    foot_height = reach * draw.between(0.2, 0.32)
    swell = draw.between(0.3, 0.8) if turned else 0.0
    rise = np.linspace(0.0, 1.0, 17)
    column = np.stack([radius * (1 + swell * np.sin(3 * np.pi * rise) ** 2 * (1 - 0.5 * rise)), rise * height], -1)
    if kind == "disc":
        rim = reach * 0.025 + 0.008
        column = column[column[:, 1] > 3 * rim]
        base = [
            [0.0, 0.0],
            [reach - rim / 2, 0.0],
            [reach, rim / 2],
            [reach - rim / 2, rim],
            [radius * 1.6, 2 * rim],
            [radius, 3 * rim],
        ]
        profile = np.concatenate([base, column, [[0.0, height]]])
    else:
        floor = foot_height * 0.35
        column[:, 1] = floor + (height - floor) * rise
        profile = np.concatenate([[[0.0, floor]], column, [[0.0, height]]])
    shape.add(part, revolve(refined(profile, step), 24))
    shape.mark("column_bottom", np.array([0.0, profile[0, 1], 0.0]))
    if kind != "disc":
        _star(shape, part, kind, reach, foot_height, radius, step)


def _star(shape: Assembly, part: str, kind: str, reach: float, high: float, radius: float, step: float) -> None:
    """Feet that slope from the column to the ground, seen from above as an X or as a star with its odd foot at the
    back."""
    width = (radius * 1.3, radius * 0.8)
    tall = (high * 0.45, high * 0.2)

    def foot(x: float, z: float) -> tuple[np.ndarray, np.ndarray]:
        inner, outer = np.array([0.0, high * 0.8, 0.0]), np.array([reach * x, tall[1] / 2, reach * z])
        inner = inner + (outer - inner) * np.array([0.3, 0.0, 0.3]) * radius / reach
        return inner, outer

    turn = np.sqrt(0.5)
    directions = [("front", turn, -turn), ("back", turn, turn)]
    if kind == "five star":
        directions = [
            ("front", np.sin(np.pi / 5), -np.cos(np.pi / 5)),
            ("back", np.cos(np.pi / 10), np.sin(np.pi / 10)),
        ]
        inner, outer = foot(0.0, 1.0)
        odd = beam(inner, outer, width, tall)
        shape.add(part, beam_solid(odd, reach, step))
        shape.mark("back_foot", at(odd, 0, -1, 1))
    for name, x, z in directions:
        place = beam(*foot(x, z), width, tall)
        shape.add_pair(part, beam_solid(place, reach, step))
        shape.mark_pair(f"{name}_foot", at(place, 0, -1, 1))
