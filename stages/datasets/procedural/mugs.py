"""Mugs: a wall with a real inside, and a handle or none. Built in centimetres; the handle is at the back, +z."""

from __future__ import annotations

import numpy as np

from b23d.stages.datasets.procedural.assembling import Assembly, BuiltShape
from b23d.stages.datasets.procedural.drawing import Chance
from b23d.stages.datasets.procedural.solids import Solid, crossing, refined, revolve, tube

KEYPOINTS = (
    "front_rim", "back_rim", "left_rim", "right_rim", "front_base", "back_base", "left_base", "right_base",
    "handle_top", "handle_bottom", "handle_outer", "inside_bottom", "underside",
)  # fmt: skip
PARTS = ("body", "handle")
COLORS = (
    {"body": "#e9e4da", "handle": "#e0d9cc"},
    {"body": "#5f8ea6", "handle": "#53819a"},
    {"body": "#d0735a", "handle": "#c1674f"},
    {"body": "#8aa583", "handle": "#e9e4da"},
    {"body": "#e3b75f", "handle": "#d5a74c"},
    {"body": "#51566b", "handle": "#c9a577"},
    {"body": "#c9a3ac", "handle": "#bd949e"},
)
STEP = 0.7
"""Longest side of a cell."""
AROUND = 48


def mug(draw: Chance) -> BuiltShape:
    """One mug."""
    form = draw.pick({"straight": 0.3, "tapered": 0.25, "bellied": 0.2, "flared": 0.15, "cup": 0.1})
    handle = draw.pick({"ring": 0.35, "square": 0.2, "ear": 0.25, "none": 0.2})
    style = {"form": form, "handle": handle}
    shape = Assembly(KEYPOINTS, PARTS, COLORS[draw.whole(0, len(COLORS) - 1)], style)
    radius, height = draw.between(3.6, 4.6), draw.between(8.0, 11.5)
    if form == "cup":
        radius, height = draw.between(4.4, 5.4), draw.between(5.5, 6.8)
    if handle == "none" and form != "cup":  # a beaker rather than a vase
        height *= 0.85
    wall, floor = draw.between(0.35, 0.6), draw.between(0.5, 0.9)
    body, marks = _body(_wall(draw, form, radius, height), wall, floor)
    shape.add("body", body)
    for where, point in marks.items():
        shape.mark(f"front_{where}", np.array([0.0, point[1], -point[0]]))
        shape.mark(f"back_{where}", np.array([0.0, point[1], point[0]]))
        shape.mark_pair(where, np.array([point[0], point[1], 0.0]))
    shape.mark("inside_bottom", np.array([0.0, floor, 0.0]))
    shape.mark("underside", np.array([0.0, _hollow(wall), 0.0]))
    if handle == "none":
        cycles = tuple((f"front_{w}", f"right_{w}", f"back_{w}", f"left_{w}") for w in marks)
        return shape.finished(draw.between(0.9, 1.1), cycles)
    _handle(shape, draw, handle, body, height, wall)
    return shape.finished(draw.between(0.9, 1.1))


def _wall(draw: Chance, form: str, radius: float, height: float) -> np.ndarray:
    """The outer wall from foot to rim: (m, 2) radius and height."""
    t = np.linspace(0.0, 1.0, 15)
    amount = draw.between(0.12, 0.28)
    share = {
        "straight": 1.0 + 0.0 * t,
        "tapered": 1.0 - amount * (1 - t),
        "bellied": 1.0 - amount * 0.9 * (2 * t - 0.9) ** 2,
        "flared": 1.0 - amount * 0.9 * np.sin(np.pi * np.minimum(1.0, 1.15 * (1 - t))) ** 2 - 0.1 * (1 - t),
        "cup": 0.5 + 0.5 * np.sqrt(1 - (1 - t) ** 2.2),
    }[form]
    return np.stack([radius * share, height * t], -1)


def _hollow(wall: float) -> float:
    """How far the underside's middle lies above the ground."""
    return 0.4 * wall


def _body(outer: np.ndarray, wall: float, floor: float) -> tuple[Solid, dict[str, np.ndarray]]:
    """One closed surface: the underside, the outer wall, the rim, the inner wall and the inside's bottom.

    Also radius and height of the rim's highest and the base's outermost circle.
    """
    foot, rim = outer[0], outer[-1]
    bevel = 0.25 * wall
    turn = np.linspace(0.0, np.pi, 7)
    lip = rim + np.array([-wall / 2, 0.0]) + wall / 2 * np.stack([np.cos(turn), np.sin(turn)], -1)
    under = [
        [0.0, _hollow(wall)],
        [foot[0] - 2.2 * wall, _hollow(wall)],
        [foot[0] - 1.6 * wall, 0.0],
        [foot[0] - bevel, 0.0],
    ]
    outside = np.concatenate(
        [[[foot[0], bevel]], outer[(outer[:, 1] > 2 * bevel) & (outer[:, 1] < rim[1] - 1e-9)], lip]
    )
    heights = outer[::-1, 1]
    inner = np.stack([outer[::-1, 0] - wall, heights], -1)[1:]
    inner = inner[inner[:, 1] > floor + 0.7 * wall]
    corner = np.interp(floor, outer[:, 1], outer[:, 0]) - wall
    inside = np.concatenate(
        [inner, [[corner - 0.25 * wall, floor + 0.25 * wall], [corner - wall, floor], [0.0, floor]]]
    )
    profile = refined(np.concatenate([under, outside, inside]), STEP)
    marks = {"rim": lip[3], "base": np.array([foot[0], bevel])}
    return revolve(profile, AROUND), marks


def _handle(shape: Assembly, draw: Chance, kind: str, body: Solid, height: float, wall: float) -> None:
    """A bow in the plane x = 0 that stands on the straight line between its two ends, which are halfway into the wall.

    The bow is half a superellipse: exponent 2.2 nearly a ring's, 4 nearly a rectangle's; an ear's is drawn out at the
    top.
    """
    squat = height < 7.0
    top, bottom = (
        height * draw.between(0.74, 0.86),
        height * (draw.between(0.4, 0.48) if squat else draw.between(0.18, 0.34)),
    )
    reach = height * (draw.between(0.42, 0.52) if squat else draw.between(0.3, 0.4))
    outside = _outer_only(body)
    low, high = (
        crossing(np.array([[0.0, h, 0.0], [0.0, h, 99.0]]), outside) - np.array([0.0, 0.0, wall / 2])
        for h in (bottom, top)
    )
    turn = np.linspace(-np.pi / 2, np.pi / 2, 33)
    sine, cosine = np.sin(turn), np.abs(np.cos(turn))
    cosine[[0, -1]] = 0.0
    power = 2 / (4.0 if kind == "square" else 2.2)
    out = reach * cosine**power * (1 + (0.35 * sine if kind == "ear" else 0.0))
    along = (1 + np.sign(sine) * np.abs(sine) ** power) / 2
    away = np.cross([1.0, 0.0, 0.0], high - low)
    away /= np.linalg.norm(away)
    path = refined(low + along[:, None] * (high - low) + out[:, None] * away, STEP)
    n = 12
    bow = tube(path, np.array([1.0, 0.0, 0.0]), (draw.between(0.4, 0.75), draw.between(0.3, 0.45)), n)
    shape.add("handle", bow)
    rings = bow.vertices[:-2].reshape(len(path), n, 3)
    far_side = max(rings[:, 0], rings[:, n // 2], key=lambda line: float(np.ptp(line[:, 1])))
    half = len(path) // 2
    shape.mark("handle_bottom", crossing(far_side[: half + 1][::-1], outside))
    shape.mark("handle_top", crossing(far_side[half:], outside))
    shape.mark("handle_outer", bow.farthest(z=1.0))


def _outer_only(body: Solid) -> Solid:
    """The faces of a mug's outer wall that touch the plane x = 0 at the back: what a handle can meet."""
    a, b, c = (body.vertices[body.faces[:, k]] for k in range(3))
    normal, middle = np.cross(b - a, c - a), (a + b + c) / 3
    at_back = (middle[:, 2] > 0) & (np.minimum(abs(a[:, 0]), np.minimum(abs(b[:, 0]), abs(c[:, 0]))) < 1e-9)
    return Solid(body.vertices, body.faces[at_back & (normal[:, 2] > 1e-9)])
