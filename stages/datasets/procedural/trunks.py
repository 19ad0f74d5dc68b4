"""Trunks of quadrupeds: rounded at both ends, deepest at the chest, with the back's line on top."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.stages.datasets.procedural.solids import Solid, circle, loft

AROUND = 24
"""Vertices of a ring; the first is on top."""


@dataclass(frozen=True)
class Trunk:
    """From the chest at z = -0.5 to the rump at 0.5; `at` runs from 0 to 1."""

    leg: float
    depth: float
    width: float
    tuck: float
    slope: float
    """How far the rump is above the withers."""
    sway: float
    """How far the back sinks between them."""

    def half_height(self, at: np.ndarray | float) -> np.ndarray:
        share = np.interp(at, [0.0, 0.25, 0.68, 0.86, 1.0], [0.86, 1.0, self.tuck, 0.5 * (1 + self.tuck), 0.72])
        return self.depth * share * _ends(at)

    def half_width(self, at: np.ndarray | float) -> np.ndarray:
        return self.width * np.interp(at, [0.0, 0.3, 0.65, 0.85, 1.0], [0.75, 1.0, 0.86, 0.97, 0.7]) * _ends(at)

    def top(self, at: np.ndarray | float) -> np.ndarray:
        """Height of the back."""
        at = np.asarray(at)
        line = self.leg + 2 * self.depth + self.slope * (at - 0.5) - self.sway * np.sin(np.pi * at)
        return line - self.depth * 0.75 * (1 - _ends(at))

    def middle(self, at: np.ndarray | float) -> np.ndarray:
        return self.top(at) - self.half_height(at)

    def stations(self) -> np.ndarray:
        bow = 0.16 * (1 - np.cos(np.linspace(0.12, np.pi / 2, 8)))
        return np.concatenate([bow, np.linspace(0.16, 0.84, 18)[1:-1], 1 - bow[::-1]])

    def solid(self) -> Solid:
        at, turn = self.stations(), circle(AROUND)
        high, wide, middle = (values(at)[:, None] for values in (self.half_height, self.half_width, self.middle))
        rings = np.stack([wide * turn[:, 0], middle + high * turn[:, 1], at[:, None] - 0.5 + 0 * turn[:, 0]], -1)
        chest, rump = (np.array([0.0, float(self.middle(at[i])), z]) for i, z in ((0, -0.5), (-1, 0.5)))
        return loft(rings, start=chest, end=rump)


def _ends(at: np.ndarray | float) -> np.ndarray:
    """1, falling to 0 at either end as a circle does."""
    near = np.clip(1 - np.minimum(np.asarray(at), 1 - np.asarray(at)) / 0.16, 0.0, 1.0)
    return np.sqrt(1 - near**2)
