"""Tables: a top, what it stands on, and perhaps an apron or a shelf. Built in metres; x is the long side.

Every table is its own image in z, too, so a half turn exchanges its keypoints; a quarter turn does where all of it is
round or square.
"""

from __future__ import annotations

import numpy as np

from b23d.stages.datasets.procedural.assembling import Assembly, BuiltShape
from b23d.stages.datasets.procedural.bases import four_legs, pedestal
from b23d.stages.datasets.procedural.drawing import Chance
from b23d.stages.datasets.procedural.forms import at, box, plate, slab
from b23d.stages.datasets.procedural.solids import Place, block, even

KEYPOINTS = (
    "left_front_corner", "right_front_corner", "left_back_corner", "right_back_corner",
    "front_edge", "back_edge", "left_edge", "right_edge",
    "left_front_foot", "right_front_foot", "left_back_foot", "right_back_foot",
    "column_bottom", "top_middle",
)  # fmt: skip
PARTS = ("top", "leg", "apron", "shelf")
COLORS = (
    {"top": "#c08a54", "leg": "#94602f", "apron": "#a97340", "shelf": "#b37f4b"},
    {"top": "#ece7dc", "leg": "#b98a5c", "apron": "#d8d0c0", "shelf": "#c79d72"},
    {"top": "#6d4a34", "leg": "#4e3425", "apron": "#5c3e2c", "shelf": "#7d5840"},
    {"top": "#9db4b5", "leg": "#4a4d50", "apron": "#7d9596", "shelf": "#86a0a1"},
    {"top": "#d9b98c", "leg": "#5f6a72", "apron": "#c4a274", "shelf": "#b8976b"},
    {"top": "#b7bcc2", "leg": "#565b62", "apron": "#8e949b", "shelf": "#a2a8af"},
)
STEP = 0.07
"""Longest side of a cell."""


def table(draw: Chance) -> BuiltShape:
    """One table."""
    top = draw.pick({"rectangular": 0.45, "rounded": 0.15, "round": 0.22, "oval": 0.18})
    base = draw.pick({"four legs": 0.5, "pedestal": 0.3, "trestle": 0.2})
    size = draw.pick({"dining": 0.4, "coffee": 0.3, "bar": 0.12, "side": 0.18})
    if base == "trestle" and (top == "round" or size in ("side", "bar")):
        base = "four legs"
    half = _half_sizes(draw, top, base, size)
    height = {"dining": (0.7, 0.78), "coffee": (0.36, 0.48), "bar": (0.95, 1.1), "side": (0.5, 0.62)}[size]
    high, thick = draw.between(*height), draw.between(0.02, 0.05)
    shape = Assembly(KEYPOINTS, PARTS, COLORS[draw.whole(0, len(COLORS) - 1)], {"top": top, "base": base, "size": size})
    roundness = {"rectangular": 0.0, "rounded": draw.between(0.15, 0.4), "round": 1.0, "oval": 1.0}[top]
    outline = _top(shape, half, high, thick, roundness, corners=roundness < 0.5)
    under = high - thick / 2
    if base == "four legs":
        _legs(shape, draw, half, outline, under, roundness)
    elif base == "trestle":
        _trestle(shape, draw, half, under, roundness)
    else:
        kind = draw.pick({"disc": 0.5, "four star": 0.5})
        shape.style["base"] = kind
        pedestal(
            shape,
            draw,
            "leg",
            kind,
            half[1] * draw.between(0.6, 0.8),
            under,
            draw.between(0.06, 0.11),
            STEP,
            draw.chance(0.6),
        )
    quarter = top == "round" and shape.style.get("braces", "none") in ("none", "ring")
    return shape.finished(draw.between(0.9, 1.1), _turns(quarter))


def _half_sizes(draw: Chance, top: str, base: str, size: str) -> tuple[float, float]:
    depth = {"dining": (0.38, 0.5), "coffee": (0.26, 0.42), "bar": (0.26, 0.36), "side": (0.2, 0.3)}[size]
    z = draw.between(*depth)
    longest = 1.5 if base in ("disc", "pedestal") or size in ("bar", "side") else 2.2
    return (z if top == "round" else z * draw.between(1.15, longest)), z


def _top(
    shape: Assembly, half: tuple[float, float], high: float, thick: float, roundness: float, corners: bool
) -> Place:
    level = plate((half[0], thick / 2, half[1]), roundness, roundness, edge=thick * 0.25)

    def place(lattice: np.ndarray) -> np.ndarray:
        return level(lattice) + np.array([0.0, high - thick / 2, 0.0])

    shape.add("top", slab(place, (2 * half[0], thick, 2 * half[1]), STEP, rounded_edges=True))
    if corners:
        shape.mark_pair("front_corner", at(place, 1, 1, -1))
        shape.mark_pair("back_corner", at(place, 1, 1, 1))
    shape.mark("front_edge", at(place, 0, 1, -1))
    shape.mark("back_edge", at(place, 0, 1, 1))
    shape.mark_pair("edge", at(place, 1, 1, 0))
    shape.mark("top_middle", at(place, 0, 1, 0))
    return place


def _legs(shape: Assembly, draw: Chance, half: tuple[float, float], top: Place, under: float, roundness: float) -> None:
    thick = draw.between(0.04, 0.075)
    corner = at(top, 1, 0, 1)
    x, z = corner[0] - thick * draw.between(0.6, 1.0), corner[2] - thick * draw.between(0.6, 1.0)
    if roundness == 1.0:
        x, z = (z, z) if half[0] == half[1] else (x, z)
    four_legs(shape, draw, "leg", (x, -z), (x, z), under, thick, STEP)
    extra = draw.pick({"none": 0.35, "apron": 0.4, "shelf": 0.25})
    if extra == "shelf" and (shape.style["legs"].endswith("splayed") or shape.style["braces"] != "none"):
        extra = "apron"
    shape.style["extra"] = extra
    if extra == "apron":
        _apron(shape, x, z, under, under * draw.between(0.86, 0.92), thick * 0.2)
    if extra == "shelf":
        low = under * draw.between(0.2, 0.4)
        shape.add("shelf", box((-x, low, -z), (x, low + 0.022, z), STEP))


def _apron(shape: Assembly, x: float, z: float, high: float, low: float, half: float) -> None:
    """Four boards from leg to leg."""
    shape.add("apron", *(box((-x, low, end * z - half), (x, high, end * z + half), STEP) for end in (-1, 1)))
    shape.add_pair("apron", box((x - half, low, -z), (x + half, high, z), STEP))


def _trestle(shape: Assembly, draw: Chance, half: tuple[float, float], under: float, roundness: float) -> None:
    """Two end frames, open or boarded, joined by a stretcher."""
    thick = draw.between(0.045, 0.08)
    x, z = half[0] * draw.between(0.6, 0.78), half[1] * (0.85 if roundness < 0.5 else 0.6)
    boarded = draw.chance(0.35)
    shape.style["base"] = "boards" if boarded else "trestle"
    if boarded:
        foot = box((x - thick / 4, 0.0, -z), (x + thick / 4, under, z), STEP)
        shape.add_pair("leg", foot)
    else:
        slope = draw.between(0.0, 0.5)

        def runner(lattice: np.ndarray) -> np.ndarray:  # the foot's upper side slopes down towards its ends
            u, v, w = lattice.T
            tall = thick * (1 - slope * np.abs(w))
            return np.stack([x + u * thick / 2, tall * (v + 1) / 2, w * z], -1)

        shape.add_pair("leg", block((2, 2, even(2 * z, STEP)), runner))
        shape.add_pair(
            "leg", box((x - thick / 2, under - thick * 0.8, -z * 0.85), (x + thick / 2, under, z * 0.85), STEP)
        )
        wide = draw.between(0.6, 2.0) * thick
        shape.add_pair(
            "leg", box((x - thick * 0.4, thick * 0.4, -wide), (x + thick * 0.4, under - thick * 0.4, wide), STEP)
        )
    low = under * draw.between(0.2, 0.55)
    shape.add("leg", box((-x, low, -thick * 0.25), (x, low + thick, thick * 0.25), STEP))
    for name, end in (("front", -z), ("back", z)):
        shape.mark_pair(f"{name}_foot", np.array([x + thick / (4 if boarded else 2), 0.0, end]))


def _turns(quarter: bool) -> tuple[tuple[str, ...], ...]:
    """Keypoints in the order in which a turn about y takes each to the next, from the front to the right, the back and
    the left."""
    corners = [("right_front", "right_back", "left_back", "left_front")]
    cycles = [tuple(f"{side}_{what}" for side in sides) for what in ("corner", "foot") for sides in corners]
    cycles.append(("front_edge", "right_edge", "back_edge", "left_edge"))
    if quarter:
        return tuple(cycles)
    return tuple((cycle[k], cycle[k + 2]) for cycle in cycles for k in (0, 1))
