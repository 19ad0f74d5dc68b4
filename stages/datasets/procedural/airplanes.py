"""Airplanes: a turned fuselage, wings, a tail, and engines or none. Built in metres; the nose is at -z."""

from __future__ import annotations

import numpy as np

from stages.datasets.procedural.assembling import Assembly, Model
from stages.datasets.procedural.drawing import Draw
from stages.datasets.procedural.solids import Solid, circle, loft, refined, revolve

KEYPOINTS = (
    "nose", "tail_end", "left_wing_tip", "right_wing_tip", "left_wing_root_front", "right_wing_root_front",
    "left_tail_tip", "right_tail_tip", "fin_top", "left_engine_front", "right_engine_front",
    "left_outer_engine_front", "right_outer_engine_front",
)  # fmt: skip
PARTS = ("body", "wing", "tail", "engine")
COLORS = (
    {"body": "#e4e6e8", "wing": "#b9bec4", "tail": "#3f6d9a", "engine": "#7d848c"},
    {"body": "#d8d3c6", "wing": "#bdb6a4", "tail": "#b95445", "engine": "#6f6a60"},
    {"body": "#8f9a8c", "wing": "#7f8a7c", "tail": "#6f7a6c", "engine": "#4f564e"},
    {"body": "#f0ead8", "wing": "#d9cfae", "tail": "#d09a3f", "engine": "#8a8478"},
)
STEP = 1.2


def airplane(draw: Draw) -> Model:
    """One airplane, some 30 m long."""
    wing = draw.pick({"swept": 0.6, "straight": 0.4})
    tail = draw.pick({"conventional": 0.5, "t-tail": 0.3, "v-tail": 0.2})
    engines = draw.pick({"none": 0.2, "two under": 0.35, "four under": 0.2, "two at tail": 0.25})
    height = draw.pick({"low": 0.6, "high": 0.4})
    winglets = draw.pick({"none": 0.65, "winglets": 0.35})
    style = {"wing": wing, "tail": tail, "engines": engines, "height": height, "winglets": winglets}
    shape = Assembly(KEYPOINTS, PARTS, COLORS[draw.whole(0, len(COLORS) - 1)], style)
    length, radius = 30.0, draw.between(1.1, 2.2)
    fuselage = _fuselage(shape, draw, length, radius)
    sweep = np.tan(np.radians(draw.between(18, 36) if wing == "swept" else draw.between(-2, 5)))
    span, chord = draw.between(10.5, 16.5), draw.between(3.6, 5.6)
    root_y = radius * (draw.between(-0.65, -0.45) if height == "low" else draw.between(0.55, 0.75))
    dihedral = np.tan(np.radians(draw.between(2, 7) if height == "low" else draw.between(-3, 2)))
    leading = -length * draw.between(0.02, 0.12)
    _wing(shape, draw, fuselage, radius, span, chord, sweep, dihedral, root_y, leading, winglets == "winglets")
    _tail(shape, draw, tail, length, radius)
    _engines(shape, draw, engines, radius, span, chord, sweep, dihedral, root_y, leading, length)
    return shape.finished(draw.between(0.9, 1.1))


def _fuselage(shape: Assembly, draw: Draw, length: float, radius: float) -> Solid:
    blunt, tail_from, rise = draw.between(0.09, 0.16), draw.between(0.6, 0.72), draw.between(0.2, 0.6)
    t = np.concatenate([np.linspace(0, blunt, 9), np.linspace(blunt, tail_from, 12)[1:], np.linspace(tail_from, 1.0, 12)[1:]])
    nose = np.sqrt(np.clip(1 - (1 - np.minimum(t / blunt, 1)) ** 2, 0, 1))
    cone = 1 - 0.86 * np.clip((t - tail_from) / (1 - tail_from), 0, 1) ** 1.6
    profile = np.stack([radius * nose * cone, length * (t - 0.5)], -1)
    profile = np.concatenate([profile, [[0.0, profile[-1, 1] + radius * 0.08]]])
    turned = revolve(refined(profile, STEP), 24)

    def lie(points: np.ndarray) -> np.ndarray:
        """From the profile's upright axis to one along z, its end lifted."""
        x, y, z = points.T
        lift = rise * radius * np.clip((y / length - (tail_from - 0.5)) / (1 - tail_from), 0, 1) ** 1.5
        return np.stack([x, -z + lift, y], -1)

    body = turned.placed(lie)
    shape.add("body", body)
    shape.mark("nose", lie(np.array([[0.0, profile[0, 1], 0.0]]))[0])
    shape.mark("tail_end", lie(np.array([[0.0, profile[-1, 1], 0.0]]))[0])
    return body


def _foil(origins: np.ndarray, chords: np.ndarray, thickness: np.ndarray, up: np.ndarray) -> Solid:
    """A wing through sections with leading edges `origins` (m, 3), `chords` (m,) along +z, thickness as a share of the chord."""
    turn = circle(16)
    z = (1 - turn[:, 1]) / 2   # 0 at the leading edge, 1 at the trailing one
    # a symmetric four-digit section's shape, thick near the front; sharp behind
    y = np.sign(turn[:, 0]) * (1.48 * np.sqrt(z) - 0.63 * z - 1.76 * z**2 + 1.42 * z**3 - 0.51 * z**4) * 0.5 * 2
    y = np.where(np.abs(turn[:, 0]) < 1e-12, 0.0, y)
    rings = origins[:, None] + chords[:, None, None] * (z[:, None] * np.array([0.0, 0.0, 1.0]) + (thickness[:, None] * y)[..., None] * up)
    return loft(refined(rings, STEP), mirror="along")


def _wing(
    shape: Assembly, draw: Draw, body: Solid, radius: float, span: float, chord: float, sweep: float, dihedral: float,
    root_y: float, leading: float, winglets: bool,
) -> None:
    taper = draw.between(0.25, 0.5) if sweep > 0.2 else draw.between(0.5, 0.85)
    share = np.array([0.0, 0.25, 0.6, 1.0])
    x = share * span
    origins = np.stack([x, root_y + dihedral * x, leading + sweep * x], -1)
    wing = _foil(origins, chord * (1 - share * (1 - taper)), np.full(4, 0.11) * (1 - 0.35 * share), np.array([0.0, 1.0, 0.0]))
    shape.add_pair("wing", wing)
    tip = origins[-1]
    # where the leading edge leaves the body: the vertex of the leading edge nearest to the body's side
    side = np.sqrt(max(radius**2 - root_y**2, 0.0)) * 1.05
    edge = wing.vertices[np.isclose(wing.vertices[:, 2] - leading - sweep * wing.vertices[:, 0], 0.0, atol=1e-6)]
    shape.mark_pair("wing_root_front", edge[np.argmin(np.abs(edge[:, 0] - side))])
    if winglets:
        rise = draw.between(1.2, 2.2)
        up = tip + np.array([[-0.1, 0.0, 0.05 * chord], [0.25 * rise, rise, 0.8 * rise]])
        winglet = _foil(up, chord * taper * np.array([0.9, 0.45]), np.array([0.08, 0.08]), np.array([-1.0, 0.25, 0.0]))
        shape.add_pair("wing", winglet)
        shape.mark_pair("wing_tip", winglet.farthest(y=1.0))
    else:
        shape.mark_pair("wing_tip", wing.farthest(x=1.0, z=-0.01))


def _tail(shape: Assembly, draw: Draw, kind: str, length: float, radius: float) -> None:
    z, chord, span = length * draw.between(0.38, 0.42), draw.between(2.4, 3.4), draw.between(3.6, 5.6)
    high, y = draw.between(3.6, 5.4), radius * 0.35
    back = draw.between(0.45, 0.8)
    if kind == "v-tail":
        tips = np.array([[0.0, y, z], [span * 0.75, y + high * 0.8, z + back * span * 0.7]])
        vane = _foil(tips, np.array([chord, chord * 0.5]), np.array([0.1, 0.09]), np.array([-0.6, 0.8, 0.0]))
        shape.add_pair("tail", vane)
        shape.mark_pair("tail_tip", vane.farthest(x=1.0, y=0.5))
        return
    tips = np.array([[0.0, y, z - 0.4], [0.0, y + high, z + back * high]])
    fin = _fin(tips, np.array([chord * 1.25, chord * 0.7]), 0.1)
    shape.add("tail", fin)
    shape.mark("fin_top", fin.farthest(y=1.0, z=0.02) * np.array([0.0, 1.0, 1.0]))
    at = np.array([0.0, y, z + 0.2]) if kind == "conventional" else np.array([0.0, y + high * 0.97, z + back * high])
    ends = at + np.array([[0.0, 0.0, 0.0], [span, 0.25, back * span * 0.6]])
    vane = _foil(ends, np.array([chord * 0.9, chord * 0.45]), np.array([0.1, 0.08]), np.array([0.0, 1.0, 0.0]))
    shape.add_pair("tail", vane)
    shape.mark_pair("tail_tip", vane.farthest(x=1.0, z=-0.01))


def _fin(tips: np.ndarray, chords: np.ndarray, thickness: float) -> Solid:
    """An upright foil in the mirror plane; vertex j of each section is the image of vertex n - j."""
    turn = circle(16)
    turn = np.stack([turn[:, 0], turn[:, 1]], -1)
    z = (1 - turn[:, 1]) / 2
    x = turn[:, 0] * np.sqrt(np.maximum(z, 0.0)) * thickness
    rings = tips[:, None] + chords[:, None, None] * np.stack([x, 0.0 * x, z], -1)
    return loft(refined(rings, STEP), start=rings[0].mean(0), end=rings[-1].mean(0))


def _engines(
    shape: Assembly, draw: Draw, kind: str, radius: float, span: float, chord: float, sweep: float, dihedral: float,
    root_y: float, leading: float, length: float,
) -> None:
    size, long = draw.between(0.55, 0.95), draw.between(2.6, 4.0)
    if kind == "none":
        return
    if kind == "two at tail":
        _nacelle(shape, np.array([radius + size * 0.9, radius * 0.45, length * draw.between(0.2, 0.27)]), size, long, "engine_front")
        return
    inner = draw.between(0.3, 0.38)
    places = {"engine_front": inner} if kind == "two under" else {"engine_front": inner, "outer_engine_front": draw.between(0.58, 0.7)}
    for name, share in places.items():
        x = share * span
        center = np.array([x, root_y + dihedral * x - size * 0.95, leading + sweep * x - long * 0.1])
        _nacelle(shape, center, size, long, name)


def _nacelle(shape: Assembly, center: np.ndarray, size: float, long: float, name: str) -> None:
    """A turned pod whose front is a shallow bowl."""
    profile = np.array([[0.0, 0.12], [0.7, 0.1], [0.92, 0.0], [1.0, 0.12], [0.95, 0.55], [0.6, 0.95], [0.35, 1.0], [0.0, 1.08]])
    turned = revolve(refined(profile * [size, long], STEP * 0.6), 20)

    def lie(points: np.ndarray) -> np.ndarray:
        return points[:, [0, 2, 1]] * np.array([1.0, -1.0, 1.0]) + center - np.array([0.0, 0.0, long / 2])

    shape.add_pair("engine", turned.placed(lie))
    shape.mark_pair(name, lie(np.array([[0.0, profile[0, 1] * long, 0.0]]))[0])
