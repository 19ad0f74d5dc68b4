"""Engines: a jet's nacelle with its fan, a propeller with its cowling, and what holds them."""

from __future__ import annotations

import numpy as np

from b23d.stages.datasets.procedural.solids import Solid, block, refined, revolve

NACELLE = np.array(
    [[0, 0.2], [0.81, 0.2], [0.82, 0.06], [0.86, 0.015], [0.91, 0], [0.96, 0.03], [1, 0.15], [1.02, 0.35],
     [0.97, 0.6], [0.72, 0.97], [0.66, 1], [0.62, 0.98], [0.3, 0.97], [0, 1.12]],
)  # fmt: skip
FAN = np.array([[0, 0.0], [0.1, 0.03], [0.2, 0.08], [0.27, 0.14], [0.84, 0.14], [0.84, 0.17], [0, 0.17]])
COWLING = np.array([[0, 0.16], [0.55, 0.16], [0.82, 0.19], [0.97, 0.28], [1, 0.45], [0.9, 0.7], [0.6, 0.92], [0, 1.02]])
SPINNER = np.array([[0, 0.0], [0.16, 0.02], [0.28, 0.07], [0.36, 0.14], [0.36, 0.2], [0, 0.2]])


def turned(profile: np.ndarray, radius: float, long: float, step: float, n: int = 24) -> Solid:
    """A profile (m, 2) of radius and way back, in shares of `radius` and `long`, turned about z; its front is at z =
    0."""
    return revolve(refined(profile * np.array([radius, long]), step), n).placed(lambda points: points[:, [0, 2, 1]])


def blades(radius: float, reach: float, z: float, cross: bool) -> list[Solid]:
    """Two level propeller blades of length `reach` in one piece, and two upright ones where `cross`."""
    wide, thin = radius * 0.22, radius * 0.05

    def place(lattice: np.ndarray) -> np.ndarray:
        u, v, w = lattice.T
        return np.stack([u * reach, v * wide * (1 - 0.55 * u**2), z + w * thin], -1)

    level = block((8, 2, 2), place)
    return [level, level.placed(lambda points: points[:, [1, 0, 2]])] if cross else [level]


def pylon(low: tuple[float, float, float], high: tuple[float, float, float], x: float, half: float) -> Solid:
    """An upright plate at x between two levels: each gives height, front z and rear z."""

    def place(lattice: np.ndarray) -> np.ndarray:
        u, v, w = lattice.T
        y, front, rear = (a * (1 - v) / 2 + b * (1 + v) / 2 for a, b in zip(low, high, strict=True))
        return np.stack([x + u * half, y, front * (1 - w) / 2 + rear * (1 + w) / 2], -1)

    return block((2, 2, 4), place)
