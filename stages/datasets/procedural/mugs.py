"""Mugs: a turned body with a real inside, and a handle or none. Built in centimetres; the handle is at the back, +z.

The mirror plane is x = 0, through the handle.
"""

from __future__ import annotations

import numpy as np

from stages.datasets.procedural.assembling import Assembly, Model
from stages.datasets.procedural.drawing import Draw
from stages.datasets.procedural.solids import refined, revolve, tube

KEYPOINTS = (
    "rim_front", "rim_back", "left_rim", "right_rim", "base_front", "base_back", "left_base", "right_base",
    "floor_middle", "handle_upper", "handle_lower", "handle_outer",
)  # fmt: skip
PARTS = ("body", "handle")
COLORS = (
    {"body": "#d9cbb2", "handle": "#b87840"},
    {"body": "#52738a", "handle": "#3f5c70"},
    {"body": "#b95445", "handle": "#9a4236"},
    {"body": "#e8e4dc", "handle": "#d2ccc0"},
    {"body": "#648467", "handle": "#4f6b52"},
)
STEP = 0.9


def mug(draw: Draw) -> Model:
    """One mug."""
    body = draw.pick({"straight": 0.35, "tapered": 0.25, "belly": 0.25, "waisted": 0.15})
    handle = draw.pick({"ring": 0.4, "ear": 0.3, "angular": 0.18, "none": 0.12})
    shape = Assembly(KEYPOINTS, PARTS, COLORS[draw.whole(0, len(COLORS) - 1)], {"body": body, "handle": handle})
    radius, height, wall = draw.between(3.4, 4.6), draw.between(7.0, 11.5), draw.between(0.25, 0.5)
    outer = _outer(draw, body, radius, height)
    inner = outer[::-1] - np.array([wall, 0.0])
    floor = draw.between(1.0, 2.0) * wall
    inner = inner[inner[:, 1] > floor + 0.2]
    lip = np.array([[outer[-1, 0] - wall / 2, height + wall * 0.35]])
    base = outer[0, 0]
    profile = np.concatenate([[[0.0, 0.0], [base - 0.3, 0.0]], outer + [0.0, 0.15] * (outer[:, 1:] == 0), lip, inner,
                              [[inner[-1, 0] - 0.2, floor], [0.0, floor]]])
    surface = revolve(refined(profile, STEP), 48)
    shape.add("body", surface)
    rim, foot = (lip[0, 0], lip[0, 1]), (base - 0.3, 0.0)
    for name, (r, y) in {"rim": rim, "base": foot}.items():
        shape.mark(f"{name}_front", np.array([0.0, y, -r]))
        shape.mark(f"{name}_back", np.array([0.0, y, r]))
        shape.mark_pair(name, np.array([r, y, 0.0]))
    shape.mark("floor_middle", np.array([0.0, floor, 0.0]))
    if handle != "none":
        _handle(shape, draw, handle, outer, height, wall)
    return shape.finished(draw.between(0.9, 1.1))


def _outer(draw: Draw, kind: str, radius: float, height: float) -> np.ndarray:
    """Outer profile (m, 2) of radius and height, from the foot to the rim."""
    rise = np.linspace(0.0, 1.0, 13)
    amount = draw.between(0.08, 0.22)
    swell = {
        "straight": 0.0 * rise,
        "tapered": amount * 1.4 * (rise - 0.5),
        "belly": amount * (np.sin(np.pi * rise) - 0.4),
        "waisted": -amount * 0.7 * np.sin(np.pi * rise),
    }[kind]
    return np.stack([radius * (1 + swell), rise * height], -1)


def _handle(shape: Assembly, draw: Draw, kind: str, outer: np.ndarray, height: float, wall: float) -> None:
    """A bent rod at +z, both ends inside the wall."""
    upper, lower = height * draw.between(0.72, 0.88), height * draw.between(0.16, 0.34)
    reach = draw.between(1.9, 3.0)
    middle, half = (upper + lower) / 2, (upper - lower) / 2
    turn = np.linspace(-np.pi / 2, np.pi / 2, 15)
    power = {"ring": 1.0, "ear": 0.75, "angular": 0.4}[kind]
    out = np.cos(turn).clip(0) ** power * reach * (1 - (0.25 * (np.sin(turn) < 0) * np.abs(np.sin(turn)) if kind == "ear" else 0.0))
    y = middle + half * np.sign(np.sin(turn)) * np.abs(np.sin(turn)) ** power
    wall_z = np.interp(y, outer[:, 1], outer[:, 0]) - wall * 0.5
    base = np.interp(np.sin(turn), [-1, 1], [wall_z[0], wall_z[-1]])
    path = np.stack([0.0 * y, y, base + out], -1)
    size = (draw.between(0.45, 0.8), draw.between(0.3, 0.5))
    rod = tube(refined(path, STEP * 0.6), np.array([1.0, 0.0, 0.0]), size)
    shape.add("handle", rod)
    shape.mark("handle_outer", rod.farthest(z=1.0))
    shape.mark("handle_upper", rod.farthest(y=1.0, z=0.15))
    shape.mark("handle_lower", rod.farthest(y=-1.0, z=0.15))
