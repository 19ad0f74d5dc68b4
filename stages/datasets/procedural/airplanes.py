"""Airplanes of five families: airliners, business jets, turboprops, light airplanes, gliders.

Built in fuselage lengths; the nose is at -z. Keypoint ids are KeypointNet's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.stages.datasets.procedural.assembling import Assembly, BuiltShape
from b23d.stages.datasets.procedural.drawing import Chance
from b23d.stages.datasets.procedural.engines import COWLING, FAN, NACELLE, SPINNER, blades, pylon, turned
from b23d.stages.datasets.procedural.forms import box
from b23d.stages.datasets.procedural.fuselages import Fuselage
from b23d.stages.datasets.procedural.solids import Solid, crossing
from b23d.stages.datasets.procedural.wings import Section, edges, fin, span

KEYPOINTS = (
    "nose", "cockpit_top", "tail_end", "left_wing_tip", "left_wing_root_front", "right_wing_tip",
    "right_wing_root_front",
    "left_tail_tip", "right_tail_tip", "fin_top", "left_tail_engine", "right_tail_engine", "left_wing_root_back",
    "right_wing_root_back", "left_inner_engine", "right_inner_engine", "left_outer_engine", "right_outer_engine",
)  # fmt: skip
PARTS = ("body", "wing", "tail", "engine")
GLASS = {"glass": "#43586b", "dark": "#3a3f46"}
COLORS = (
    {"body": "#eceef0", "wing": "#b6bdc5", "tail": "#3f6d9a", "engine": "#8b949d"},
    {"body": "#f1ede4", "wing": "#c3c0b8", "tail": "#b95445", "engine": "#b95445"},
    {"body": "#e8ebe6", "wing": "#aeb6ad", "tail": "#5d8a66", "engine": "#dfe3dd"},
    {"body": "#f0e3c4", "wing": "#e3cf9c", "tail": "#d0913f", "engine": "#8a8478"},
    {"body": "#c9d6e0", "wing": "#9fb1bf", "tail": "#2f4a63", "engine": "#6f8191"},
)
STEP = 0.045
"""Longest side of a cell."""


@dataclass(frozen=True)
class Wing:
    """The right wing's plan: the edges are straight, the chord changes at the kink."""

    half_span: float
    chords: tuple[float, float, float]
    """At the middle, the kink and the tip."""
    kink: float
    """Where, as a share of the half span."""
    sweep: float
    """Way back per way out, of the leading edge."""
    dihedral: float
    """Way up per way out."""
    y: float
    z: float

    def section(self, share: float, thickness: float = 0.11) -> Section:
        x = share * self.half_span
        chord = float(np.interp(share, [0.0, self.kink, 1.0], self.chords))
        bank = float(np.arctan(self.dihedral)) if share > 0 else 0.0
        return Section((x, self.y + self.dihedral * x, self.z + self.sweep * x), chord, thickness, bank)


def airplane(draw: Chance) -> BuiltShape:
    """One airplane."""
    family = draw.pick({"airliner": 0.36, "business": 0.2, "turboprop": 0.17, "light": 0.15, "glider": 0.12})
    shape = Assembly(KEYPOINTS, PARTS, COLORS[draw.whole(0, len(COLORS) - 1)] | GLASS, {"family": family})
    fuselage = _fuselage(draw, family)
    body = fuselage.solid(STEP)
    shape.add("body", body)
    shape.mark("tail_end", body.vertices[-1])
    wing = _wing_plan(draw, family, fuselage, shape.style)
    _cockpit(shape, draw, family, fuselage, wing, body)
    _wing(shape, draw, family, wing, body)
    _tail(shape, draw, family, fuselage)
    _engines(shape, draw, family, fuselage, wing)
    return shape.finished(draw.between(0.9, 1.1))


def _fuselage(draw: Chance, family: str) -> Fuselage:
    if family == "light":
        return Fuselage(draw.between(0.072, 0.088), 0.2, 0.36, 0.2, False, 0.15, 0.35, 0.5)
    if family == "glider":
        return Fuselage(draw.between(0.05, 0.06), 0.24, 0.34, 0.26, True, 0.2, draw.between(0.2, 0.6), 0.0)
    radius = {"airliner": (0.05, 0.064), "business": (0.052, 0.062), "turboprop": (0.055, 0.068)}[family]
    return Fuselage(
        draw.between(*radius), draw.between(0.12, 0.19), draw.between(0.58, 0.68), draw.between(0.1, 0.2), False,
        draw.between(0.15, 0.4), draw.between(0.35, 0.7), 0.0,
    )  # fmt: skip


def _wing_plan(draw: Chance, family: str, fuselage: Fuselage, style: dict[str, str]) -> Wing:
    high = draw.chance({"airliner": 0.12, "business": 0.0, "turboprop": 0.6, "light": 0.5, "glider": 0.6}[family])
    style["height"] = "high" if high else "low"
    y = fuselage.radius * (draw.between(0.6, 0.75) if high else draw.between(-0.65, -0.45))
    dihedral = np.tan(
        np.radians(draw.between(-2.0, 1.5) if high and family == "airliner" else draw.between(2.0, 6.5) - 2.0 * high)
    )
    if family in ("airliner", "business"):
        root, tip = draw.between(0.19, 0.25), draw.between(0.05, 0.075)
        sweep, half = np.tan(np.radians(draw.between(24, 36))), draw.between(0.42, 0.56)
        kink = draw.between(0.3, 0.4)
        chords = (root, tip + (root - tip) * draw.between(0.42, 0.55), tip)
        return Wing(
            half, chords, kink, sweep, dihedral, y, draw.between(-0.16, -0.1) + (0.08 if family == "business" else 0.0)
        )
    root, half, sweep = {
        "turboprop": (draw.between(0.13, 0.16), draw.between(0.48, 0.58), draw.between(0.0, 0.08)),
        "light": (draw.between(0.17, 0.22), draw.between(0.6, 0.72), draw.between(0.0, 0.06)),
        "glider": (draw.between(0.12, 0.15), draw.between(0.75, 1.0), draw.between(-0.01, 0.03)),
    }[family]
    taper = draw.between(0.45, 0.95) if family == "light" else draw.between(0.4, 0.6)
    front = {"turboprop": -0.11, "light": -0.24, "glider": -0.2}[family]
    return Wing(
        half, (root, root, root * taper), draw.between(0.35, 0.6), sweep, dihedral, y, front + draw.between(-0.02, 0.03)
    )


def _cockpit(shape: Assembly, draw: Chance, family: str, fuselage: Fuselage, wing: Wing, body: Solid) -> None:
    """Glass, the keypoints at the front, and an airliner's line of windows."""
    if family != "light":  # a light airplane's nose is its propeller's
        shape.mark("nose", body.vertices[-2])
    if family == "glider" or (family == "light" and shape.style["height"] == "low"):
        center = 0.17 if family == "glider" else 0.34
        canopy = fuselage.canopy(center, draw.between(0.22, 0.28))
        shape.add("body", canopy, tint="glass")
        shape.mark("cockpit_top", canopy.farthest(y=1.0))
        return
    if family == "light":
        last = wing.z + 0.5 - 0.006
        glass = fuselage.windshield(last - 0.07, last, 1.3)
    else:
        glass = fuselage.windshield(fuselage.nose * 0.3, fuselage.nose * draw.between(0.5, 0.62), 1.15)
    shape.add("body", glass, tint="glass")
    back = glass.vertices[:-2]  # without the middles of its ends
    shape.mark("cockpit_top", back[np.argmax(back[:, 2] + 0.01 * back[:, 1])])
    if family != "light":
        wide, y = fuselage.radius * 0.985, fuselage.radius * 0.2
        ends = fuselage.nose * 1.05 - 0.5, fuselage.tail * 0.97 - 0.5
        shape.add("body", box((-wide, y, ends[0]), (wide, y + fuselage.radius * 0.14, ends[1]), STEP), tint="glass")


def _wing(shape: Assembly, draw: Chance, family: str, wing: Wing, body: Solid) -> None:
    sections = [wing.section(0.0, 0.13), wing.section(wing.kink, 0.12), wing.section(1.0, 0.1)]
    for name, edge in zip(("front", "back"), edges(sections), strict=True):
        shape.mark_pair(f"wing_root_{name}", crossing(edge, body))
    tips = draw.pick({"plain": 0.5, "winglets": 0.5}) if family in ("airliner", "business", "glider") else "plain"
    shape.style["tips"] = tips
    if tips == "winglets":
        sections += _winglet(
            sections[-1], draw.between(0.035, 0.07) * (0.7 if family == "glider" else 1.0), draw.between(1.0, 1.4)
        )
    solid = span(sections, STEP)
    shape.add("wing", solid)
    shape.mark_pair("wing_tip", solid.vertices[-1])


def _winglet(tip: Section, high: float, bank: float) -> list[Section]:
    """Sections of a tip that bends upwards to `bank` radians."""
    x, y, z = tip.leading
    bow = high * 0.35
    return [
        Section((x + bow * 0.8, y + bow * 0.35, z + bow), tip.chord * 0.9, 0.09, bank / 2),
        Section((x + bow * 1.2, y + bow, z + bow * 1.9), tip.chord * 0.75, 0.08, bank),
        Section(
            (x + bow * 1.2 + (high - bow) / np.tan(bank), y + high, z + bow * 1.9 + high), tip.chord * 0.4, 0.08, bank
        ),
    ]


def _tail(shape: Assembly, draw: Chance, family: str, fuselage: Fuselage) -> None:
    kinds = {
        "airliner": {"conventional": 0.9, "T": 0.1}, "business": {"T": 0.75, "conventional": 0.25},
        "turboprop": {"T": 0.4, "conventional": 0.6}, "light": {"conventional": 0.7, "V": 0.3},
        "glider": {"T": 0.5, "V": 0.3, "conventional": 0.2},
    }  # fmt: skip
    kind = draw.pick(kinds[family])
    shape.style["tail"] = kind
    swept = draw.between(0.5, 0.8) if family in ("airliner", "business") else draw.between(0.15, 0.4)
    chord, half = draw.between(0.1, 0.13), draw.between(0.15, 0.2)
    if family == "glider":
        chord, half = chord * 0.7, half * 0.85
    front = 0.49 - 1.15 * chord - (swept * 0.08 if kind == "conventional" else 0.0)
    y = float(fuselage.middle(front + 0.5))
    if kind == "V":
        dihedral = np.tan(np.radians(draw.between(36, 44)))
        _tailplane(shape, Wing(half * 0.85, (chord * 1.1, chord, chord * 0.6), 0.3, swept * 0.7, dihedral, y, front))
        return
    high = draw.between(0.13, 0.18) * (0.85 if family == "glider" else 1.0)
    low = float(fuselage.middle(0.96))
    base, top = chord * draw.between(1.35, 1.6), chord * draw.between(0.65, 0.9)
    behind = 0.488 - base
    rise = fuselage.radius * 0.6 + high
    foot, head = Section((0.0, low, behind), base, 0.09), Section((0.0, low + rise, behind + swept * rise), top, 0.09)
    upright = fin([foot, head], STEP)
    shape.add("tail", upright)
    if kind == "conventional":
        shape.mark("fin_top", upright.vertices[-1])
        _tailplane(
            shape, Wing(half, (chord, chord * 0.85, chord * 0.5), 0.3, swept * 0.9, draw.between(0.0, 0.12), y, front)
        )
        return
    plan = Wing(half * 0.85, (top * 1.1, top, top * 0.6), 0.3, swept * 0.6, 0.0, low + rise, head.leading[2] - 0.02)
    plane = _tailplane(shape, plan)
    middle = plane.vertices[plane.vertices[:, 0] == 0]
    shape.mark("fin_top", middle[np.argmax(middle[:, 1])])


def _tailplane(shape: Assembly, plan: Wing) -> Solid:
    solid = span([plan.section(share, 0.1) for share in (0.0, plan.kink, 1.0)], STEP)
    shape.add("tail", solid)
    shape.mark_pair("tail_tip", solid.vertices[-1])
    return solid


def _engines(shape: Assembly, draw: Chance, family: str, fuselage: Fuselage, wing: Wing) -> None:
    shape.style["engines"] = "none"
    if family == "light":
        shape.style["engines"] = "nose"
        radius = fuselage.radius * 0.55
        spinner = turned(SPINNER, radius, 0.2, STEP).moved(y=float(fuselage.middle(0.0)), z=-0.53)
        shape.add("engine", spinner)
        shape.mark("nose", spinner.vertices[-2])
        vanes = blades(radius, fuselage.radius * draw.between(1.7, 2.0), -0.51, cross=draw.chance(0.4))
        shape.add("engine", *(vane.moved(y=float(fuselage.middle(0.0))) for vane in vanes), tint="dark")
    elif family == "business":
        shape.style["engines"] = "two at tail"
        radius, long = draw.between(0.026, 0.034), draw.between(0.13, 0.16)
        front = draw.between(0.64, 0.7)
        beside = float(fuselage.half_width(front + 0.05))
        x, y = beside + radius * 1.35, float(fuselage.middle(front + 0.05)) + 0.35 * beside
        _jet(shape, "tail_engine", radius, long, (x, y, front - 0.5))
        thin = radius * 0.16
        shape.add_pair(
            "engine",
            box((beside * 0.5, y - thin, front - 0.5 + long * 0.35), (x, y + thin, front - 0.5 + long * 0.85), STEP),
        )
    elif family in ("airliner", "turboprop"):
        count = "four" if draw.chance(0.35) else "two"
        shape.style["engines"] = f"{count} at wing"
        size = draw.between(0.03, 0.038) if count == "two" else draw.between(0.025, 0.03)
        shares = {"inner": draw.between(0.3, 0.36), "outer": draw.between(0.56, 0.66)}
        for name, share in list(shares.items())[: 2 if count == "four" else 1]:
            place = wing.section(share)
            if family == "airliner":
                _jet_under(shape, f"{name}_engine", size, size * draw.between(3.4, 4.2), place)
            else:
                _propeller(shape, f"{name}_engine", size * 0.8, size * 5.5, place)


def _jet(shape: Assembly, name: str, radius: float, long: float, front: tuple[float, float, float]) -> None:
    """A pair of nacelles; `front`: the middle of the right one's front."""
    fan = turned(FAN, radius, long, STEP / 2).moved(*front)
    shape.add_pair("engine", turned(NACELLE, radius, long, STEP / 2).moved(*front))
    shape.add_pair("engine", fan, tint="dark")
    shape.mark_pair(name, fan.vertices[-2])


def _jet_under(shape: Assembly, name: str, radius: float, long: float, wing: Section) -> None:
    x, y, z = wing.leading
    center, front = y - radius * 1.25, z - long * 0.55
    _jet(shape, name, radius, long, (x, center, front))
    low = (center + radius * 0.6, front + long * 0.25, front + long * 0.8)
    shape.add_pair("engine", pylon(low, (y, z + wing.chord * 0.03, z + wing.chord * 0.5), x, radius * 0.14))


def _propeller(shape: Assembly, name: str, radius: float, long: float, wing: Section) -> None:
    x, y, z = wing.leading
    front = (x, y, z - long * 0.52)
    spinner = turned(SPINNER, radius, long, STEP / 2).moved(*front)
    shape.add_pair("engine", turned(COWLING, radius, long, STEP / 2).moved(*front), spinner)
    shape.add_pair(
        "engine", *(vane.moved(*front) for vane in blades(radius, radius * 2.4, long * 0.12, cross=True)), tint="dark"
    )
    shape.mark_pair(name, spinner.vertices[-2])
