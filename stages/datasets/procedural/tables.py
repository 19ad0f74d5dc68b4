"""Tables: a top, what it stands on, and perhaps an apron or a shelf. Built in metres; the front is at -z."""

from __future__ import annotations

import numpy as np

from stages.datasets.procedural.assembling import Assembly, Model
from stages.datasets.procedural.bases import four_legs, pedestal
from stages.datasets.procedural.drawing import Draw
from stages.datasets.procedural.forms import at, beam, beam_solid, box, plate, slab
from stages.datasets.procedural.solids import Place

KEYPOINTS = (
    "left_top_front", "right_top_front", "left_top_back", "right_top_back", "top_middle",
    "left_front_foot", "right_front_foot", "left_back_foot", "right_back_foot", "column_bottom", "back_foot",
)  # fmt: skip
PARTS = ("top", "leg", "apron", "shelf")
COLORS = (
    {"top": "#c08a5a", "leg": "#8a5a36", "apron": "#a87445", "shelf": "#b07d4e"},
    {"top": "#e6e0d4", "leg": "#b9895c", "apron": "#c59a6e", "shelf": "#ddd3c2"},
    {"top": "#4a5560", "leg": "#a9adb2", "apron": "#5a6570", "shelf": "#535e69"},
    {"top": "#7d4f38", "leg": "#6b4230", "apron": "#744834", "shelf": "#7a4c37"},
    {"top": "#9db0a5", "leg": "#d6c7ae", "apron": "#8da196", "shelf": "#a6b6ac"},
)
STEP = 0.07


def table(draw: Draw) -> Model:
    """One table."""
    top = draw.pick({"rectangular": 0.5, "round": 0.25, "oval": 0.25})
    base = draw.pick({"four legs": 0.55, "pedestal": 0.25, "trestle": 0.2})
    if top == "round" and base == "trestle":
        base = "pedestal"
    extra = draw.pick({"none": 0.45, "apron": 0.35, "shelf": 0.2}) if base == "four legs" else "none"
    if top != "rectangular" and extra == "apron":
        extra = "none"
    half_x, half_z = draw.between(0.4, 0.95), draw.between(0.3, 0.5)
    if top == "round":
        half_x = half_z = draw.between(0.35, 0.65)
    height, thick = draw.between(0.4, 0.95), draw.between(0.02, 0.05)
    shape = Assembly(KEYPOINTS, PARTS, COLORS[draw.whole(0, len(COLORS) - 1)], {"top": top, "base": base, "extra": extra})
    place = _top(shape, draw, half_x, half_z, height, thick, 0.0 if top == "rectangular" else 1.0)
    under = height - thick / 2
    if base == "four legs":
        _legs(shape, draw, place, under, extra, thick)
    elif base == "pedestal":
        kind = draw.pick({"disc": 0.4, "four star": 0.35, "five star": 0.25})
        shape.style["base"] = kind
        pedestal(shape, draw, "leg", kind, min(half_x, half_z) * draw.between(0.6, 0.85), under, draw.between(0.08, 0.13), STEP, draw.chance(0.5))
    else:
        _trestle(shape, draw, half_x, half_z, under)
    return shape.finished(draw.between(0.9, 1.1))


def _top(shape: Assembly, draw: Draw, half_x: float, half_z: float, height: float, thick: float, roundness: float) -> Place:
    level = plate((half_x, thick / 2, half_z), roundness, roundness, thick * draw.between(0.1, 0.4))

    def place(lattice: np.ndarray) -> np.ndarray:
        return level(lattice) + np.array([0.0, height - thick / 2, 0.0])

    shape.add("top", slab(place, (2 * half_x, thick, 2 * half_z), STEP, rounded_edges=True))
    shape.mark_pair("top_front", at(place, 1, 1, -1))
    shape.mark_pair("top_back", at(place, 1, 1, 1))
    shape.mark("top_middle", at(place, 0, 1, 0))
    return place


def _legs(shape: Assembly, draw: Draw, place: Place, under: float, extra: str, thick: float) -> None:
    inset, width = draw.between(0.8, 0.93), draw.between(0.035, 0.08)
    front, back = at(place, 1, 0, -1) * inset, at(place, 1, 0, 1) * inset
    four_legs(shape, draw, "leg", (front[0], front[2]), (back[0], back[2]), under, width, STEP)
    x, z = front[0], back[2]
    if extra == "apron":
        low, half = under - draw.between(0.06, 0.12), 0.01
        for end in (-z, z):
            shape.add("apron", box((-x, low, end - half), (x, under, end + half), STEP))
        side = box((x - half, low, -z), (x + half, under, z), STEP)
        shape.add_pair("apron", side)
    if extra == "shelf":
        at_height = under * draw.between(0.25, 0.45)
        shape.add("shelf", box((-x, at_height, -z), (x, at_height + thick * 0.7, z), STEP))


def _trestle(shape: Assembly, draw: Draw, half_x: float, half_z: float, under: float) -> None:
    """A pair of uprights on feet, with a stretcher between them."""
    x, wide, thick = half_x * draw.between(0.55, 0.75), half_z * draw.between(0.2, 0.5), draw.between(0.02, 0.035)
    foot = draw.between(0.035, 0.06)
    reach = half_z * draw.between(0.75, 0.95)
    shape.add_pair("leg", box((x - thick, foot * 0.5, -wide), (x + thick, under, wide), STEP))
    runner = beam(np.array([x, foot / 2, -reach]), np.array([x, foot / 2, reach]), (2.6 * thick, 2.6 * thick), (foot, foot))
    shape.add_pair("leg", beam_solid(runner, 2 * reach, STEP))
    across = under * draw.between(0.25, 0.5)
    shape.add("leg", box((-x, across, -0.015), (x, across + 0.05, 0.015), STEP))
    shape.mark_pair("front_foot", at(runner, 0, -1, -1))
    shape.mark_pair("back_foot", at(runner, 0, -1, 1))
