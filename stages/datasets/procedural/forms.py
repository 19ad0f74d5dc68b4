"""Forms that furniture is made of: plates, bars and posts, as blocks of the lattice put in place.

Lattice coordinates (u, v, w) run over [-1, 1]³: u towards the right, v upwards, w backwards.
"""

from __future__ import annotations

import numpy as np

from b23d.stages.datasets.procedural.solids import Place, Solid, block, even


def plate(
    half: tuple[float, float, float],
    front: float = 0.0,
    back: float = 0.0,
    edge: float = 0.0,
    taper: float = 0.0,
    dome: float = 0.0,
) -> Place:
    """Where a lattice point goes in a level plate with half sizes `half`, centred at the origin.

    `front`, `back`: roundness of the outline of either half, 0 a rectangle's, 1 an ellipse's. `edge`: radius of the
    edges. `taper`: by what share the back is narrower than the middle (and the front wider). `dome`: height the middle
    rises.
    """

    def place(lattice: np.ndarray) -> np.ndarray:
        u, v, w = lattice.T
        roundness = np.where(w < 0, front, back)
        inset = edge * (1 - np.sqrt(np.maximum(0.0, 1 - v**2)))
        x = (half[0] - inset) * u * np.sqrt(1 - roundness * w**2 / 2) * (1 - taper * w)
        y = half[1] * v + dome * (1 - u**2) * (1 - w**2) * (v + 1) / 2
        z = (half[2] - inset) * w * np.sqrt(1 - roundness * u**2 / 2)
        return np.stack([x, y, z], -1)

    return place


def upright(place: Place) -> Place:
    """A level plate put up: what was its back is its top, what was its top is its back."""

    def put_up(lattice: np.ndarray) -> np.ndarray:
        return place(lattice[:, [0, 2, 1]])[:, [0, 2, 1]]

    return put_up


def slab(place: Place, size: tuple[float, float, float], step: float, rounded_edges: bool = False) -> Solid:
    """A block of about `size` with cells of about `step`; four cells through its thinnest side where edges are
    rounded."""
    cells = [even(length, step) for length in size]
    if rounded_edges:
        cells[int(np.argmin(size))] = 4
    return block((cells[0], cells[1], cells[2]), place)


def box(low: tuple[float, float, float], high: tuple[float, float, float], step: float) -> Solid:
    """An axis-aligned box between two corners."""
    a, b = np.array(low), np.array(high)
    size = b - a
    return slab(lambda lattice: (a + b) / 2 + lattice * size / 2, (size[0], size[1], size[2]), step)


def post(
    top: np.ndarray, bottom: np.ndarray, half_top: tuple[float, float], half_bottom: tuple[float, float], round_: bool
) -> Place:
    """A leg or post from `bottom` to `top` (3,), ends level; half sizes in x and z at either end."""

    def place(lattice: np.ndarray) -> np.ndarray:
        u, v, w = lattice.T
        up = (v[:, None] + 1) / 2
        half = np.array(half_bottom) * (1 - up) + np.array(half_top) * up
        across = np.stack([u * np.sqrt(1 - round_ * w**2 / 2), w * np.sqrt(1 - round_ * u**2 / 2)], -1) * half
        axis = bottom * (1 - up) + top * up
        return axis + np.stack([across[:, 0], 0.0 * v, across[:, 1]], -1)

    return place


def post_solid(place: Place, length: float, step: float, round_: bool) -> Solid:
    """A post with four cells a side where it is round, two where it is square."""
    around = 4 if round_ else 2
    return block((around, even(length, step), around), place)


def beam(start: np.ndarray, end: np.ndarray, width: tuple[float, float], height: tuple[float, float]) -> Place:
    """A bar from `start` to `end` (3,): w runs along it, u across it and level, v upright. Sizes are (at start, at
    end)."""
    along = end - start
    across = np.array([along[2], 0.0, -along[0]]) / np.hypot(along[0], along[2])

    def place(lattice: np.ndarray) -> np.ndarray:
        u, v, w = lattice.T[:, :, None]
        t = (w + 1) / 2
        wide, high = (size[0] * (1 - t) + size[1] * t for size in (width, height))
        return start * (1 - t) + end * t + u * wide / 2 * across + v * high / 2 * np.array([0.0, 1.0, 0.0])

    return place


def beam_solid(place: Place, length: float, step: float) -> Solid:
    return block((2, 2, even(length, step)), place)


def at(place: Place, u: float, v: float, w: float) -> np.ndarray:
    """Where one lattice point goes: (3,)."""
    return place(np.array([[u, v, w]]))[0]
