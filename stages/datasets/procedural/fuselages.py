"""Fuselages: a turned profile along z whose middle line sinks at the nose and rises at the tail, and its cockpit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.stages.datasets.procedural.solids import Solid, circle, loft, refined, revolve


@dataclass(frozen=True)
class Fuselage:
    """From the nose at z = -0.5 to the tail at z = 0.5. All lengths in fuselage lengths; `at` runs from 0 to 1."""

    radius: float
    nose: float
    """Where the nose ends."""
    tail: float
    """Where the tail begins."""
    end: float
    """Radius of the tail's end, as a share."""
    boom: bool
    """The tail narrows at once and goes on as a boom (a glider's), instead of all the way."""
    droop: float
    """How far the nose's tip lies below the middle line, in radii."""
    rise: float
    """How far the tail's end lies above it, in radii."""
    blunt: float
    """Radius of the nose's flat front, as a share."""

    def half_width(self, at: np.ndarray | float) -> np.ndarray:
        before = np.clip(1 - np.asarray(at) / self.nose, 0.0, 1.0)
        behind = np.clip((np.asarray(at) - self.tail) / (1 - self.tail), 0.0, 1.0)
        front = self.blunt + (1 - self.blunt) * np.sqrt(1 - before**2.2)
        if self.boom:
            steep = np.minimum(1.0, behind / 0.45)
            return self.radius * front * (1 - (1 - self.end) * (0.8 * steep**2 * (3 - 2 * steep) + 0.2 * behind))
        return self.radius * front * (1 - (1 - self.end) * behind**1.7)

    def middle(self, at: np.ndarray | float) -> np.ndarray:
        """Height of the middle line."""
        before = np.clip(1 - np.asarray(at) / self.nose, 0.0, 1.0)
        behind = np.clip((np.asarray(at) - self.tail) / (1 - self.tail), 0.0, 1.0)
        return self.radius * (self.rise * behind**1.4 - self.droop * before**2)

    def solid(self, step: float) -> Solid:
        """Its surface; the last two vertices are the tip of the nose and the tail's end."""
        early = self.nose * (1 - np.cos(np.linspace(0.12, np.pi / 2, 12)))
        stations = np.concatenate([early, np.linspace(self.nose, 1.0, 34)[1:]])
        turn = circle(28)
        radius, middle = self.half_width(stations)[:, None], self.middle(stations)[:, None]
        rings = np.stack(
            [radius * turn[:, 0], middle + radius * turn[:, 1], stations[:, None] - 0.5 + 0.0 * turn[:, 0]], -1
        )
        tip = np.array([0.0, self.middle(0.0), -0.5])
        end = np.array([0.0, self.middle(1.0), 0.5 + 0.4 * self.radius * self.end])
        return loft(refined(rings, step), start=tip, end=end)

    def windshield(self, first: float, last: float, reach: float) -> Solid:
        """A band of glass over the top from `first` to `last` (of the length), `reach` radians down either side."""
        stations = np.linspace(first, last, 6)
        angle = np.linspace(0.0, reach, 11)
        radius, middle = 1.015 * self.half_width(stations)[:, None], self.middle(stations)[:, None]
        arc = np.stack(
            [radius * np.sin(angle), middle + radius * np.cos(angle), stations[:, None] - 0.5 + 0.0 * angle], -1
        )
        floor = arc[:, -1:] * np.array([0.0, 1.0, 1.0]) - np.stack([0 * radius, 0.2 * radius, 0 * radius], -1)
        return loft(np.concatenate([arc, floor, arc[:, :0:-1] * np.array([-1.0, 1.0, 1.0])], 1))

    def canopy(self, at: float, long: float) -> Solid:
        """A bubble half sunk into the top, `long` from front to rear; its first and last but one vertex are its
        poles."""
        turn = np.linspace(-np.pi / 2, np.pi / 2, 13)
        ball = revolve(np.stack([np.cos(turn) * (np.abs(turn) < 1.57), np.sin(turn)], -1), 24)
        wide = float(self.half_width(at))
        place = np.array([0.0, float(self.middle(at)) + 0.62 * wide, at - 0.5])
        return ball.placed(lambda points: points * np.array([0.72 * wide, 0.78 * wide, long / 2]) + place)
