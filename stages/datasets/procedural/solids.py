"""Solids: closed, outward-oriented triangle surfaces, exactly mirror symmetric where they are built around x = 0.

Exactness is by construction: sines come from one table of a quarter turn, diagonals of quads are mirrored, and whatever
stands at the right (+x) is repeated at the left by negating x, which floating point does without error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

Place = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Solid:
    """One closed surface. `vertices` float64 (v, 3), `faces` int64 (f, 3), counter-clockwise seen from outside."""

    vertices: np.ndarray
    faces: np.ndarray

    def placed(self, place: Place) -> Solid:
        """The same surface with `place` applied to its vertices; turned outwards again if `place` mirrors."""
        return _outward(place(self.vertices), self.faces)

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Solid:
        return Solid(self.vertices + np.array([x, y, z]), self.faces)

    def mirrored(self) -> Solid:
        """Its image in the plane x = 0."""
        return Solid(self.vertices * np.array([-1.0, 1.0, 1.0]), self.faces[:, ::-1])

    def farthest(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> np.ndarray:
        """The vertex (3,) that lies farthest in a direction; the first of several."""
        return self.vertices[np.argmax(np.round(self.vertices @ np.array([x, y, z]), 9))]


def even(length: float, step: float) -> int:
    """Smallest even number of cells, at least 2, that are no longer than `step`: so that 0 is a vertex of a lattice."""
    return 2 * max(1, int(np.ceil(length / (2 * step) - 1e-9)))


def block(cells: tuple[int, int, int], place: Place) -> Solid:
    """The surface of the cube [-1, 1]³, cut into `cells` quads a side (even numbers), moved by `place` (v, 3) → (v, 3).

    Diagonals point at the nearest corner of their side, hence are symmetric in all three axes.
    """
    index = np.arange((cells[0] + 1) * (cells[1] + 1) * (cells[2] + 1)).reshape([n + 1 for n in cells])
    quads, flips = [], []
    for axis in range(3):
        b, c = (axis + 1) % 3, (axis + 2) % 3
        flip = (np.arange(cells[b])[:, None] < cells[b] // 2) ^ (np.arange(cells[c])[None, :] < cells[c] // 2)
        for end, order in ((-1, (0, 1, 2, 3)), (0, (0, 3, 2, 1))):
            side = np.moveaxis(index, (axis, b, c), (0, 1, 2))[end]
            corners = np.stack([side[:-1, :-1], side[1:, :-1], side[1:, 1:], side[:-1, 1:]], -1)
            quads.append(corners.reshape(-1, 4)[:, order])
            flips.append(flip.ravel())
    faces = _split(np.concatenate(quads), np.concatenate(flips))
    used = np.zeros(index.size, bool)
    used[faces] = True
    lattice = np.stack(np.unravel_index(np.flatnonzero(used), index.shape), -1)
    half = np.array(cells) // 2
    return _outward(place((lattice - half) / half), (np.cumsum(used) - 1)[faces])


def loft(
    rings: np.ndarray,
    start: np.ndarray | None = None,
    end: np.ndarray | None = None,
    mirror: Literal["around", "along"] = "around",
) -> Solid:
    """A skin over closed rings (m, n, 3) of equal n, closed by fans at both ends.

    `start`, `end` (3,): the middle of each fan; the mean of the ring where None.
    `mirror`: how the solid is symmetric in x. "around": vertex j of each ring is the image of vertex n - j (vertex 0
    has x = 0). "along": ring i is the image of ring m - 1 - i, vertex for vertex.
    """
    m, n = rings.shape[:2]
    tips = [
        ring.mean(0) if tip is None else np.asarray(tip, float) for tip, ring in ((start, rings[0]), (end, rings[-1]))
    ]
    if mirror == "around":
        tips = [tip * np.array([0.0, 1.0, 1.0]) for tip in tips]
    i, j = np.meshgrid(np.arange(m - 1), np.arange(n), indexing="ij")
    following = (j + 1) % n
    quads = np.stack([i * n + j, i * n + following, (i + 1) * n + following, (i + 1) * n + j], -1).reshape(-1, 4)
    flip = (j >= n // 2) if mirror == "around" else (i >= (m - 1) // 2)
    around, last = np.arange(n), (m - 1) * n
    first_fan = np.stack([np.roll(around, -1), around, np.full(n, m * n)], -1)
    last_fan = np.stack([last + around, last + np.roll(around, -1), np.full(n, m * n + 1)], -1)
    faces = np.concatenate([_split(quads, flip.ravel()), first_fan, last_fan])
    return _outward(np.concatenate([rings.reshape(-1, 3), np.stack(tips)]), faces)


def circle(n: int) -> np.ndarray:
    """(n, 2) sines and cosines of a full turn from 0; n a multiple of 4; exactly symmetric under mirrors and quarter
    turns."""
    quarter = np.sin(np.linspace(0.0, np.pi / 2, n // 4 + 1))
    quarter[0], quarter[-1] = 0.0, 1.0
    rise, fall = quarter[:-1], quarter[:0:-1]
    sine = np.concatenate([rise, fall, -rise, -fall])
    return np.stack([sine, np.roll(sine, -(n // 4))], -1)


def revolve(profile: np.ndarray, n: int = 32) -> Solid:
    """The profile (m, 2) of radius and height, turned about the y axis. First and last radius are 0: the poles."""
    turn = circle(n)
    radius, height = profile[1:-1, :1], profile[1:-1, 1:]
    rings = np.stack([radius * turn[:, 0], height + 0.0 * turn[:, 0], radius * turn[:, 1]], -1)
    return loft(rings, start=np.array([0.0, profile[0, 1], 0.0]), end=np.array([0.0, profile[-1, 1], 0.0]))


def tube(path: np.ndarray, across: np.ndarray, size: tuple[float, float], n: int = 12) -> Solid:
    """A tube with an elliptic section along a plane path (m, 3).

    `across` (3,): unit normal of the path's plane. `size`: half axes of the section, across the plane and in it. Along
    a path in x = 0 the solid is symmetric "around"; along one that is its own image in x, "along".
    """
    forward = np.gradient(path, axis=0)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    inward = np.cross(forward, across)
    turn = circle(n)
    offsets = size[0] * turn[:, :1] * across + size[1] * turn[:, 1:] * inward[:, None, :]
    return loft(
        path[:, None, :] + offsets, start=path[0], end=path[-1], mirror="around" if abs(across[0]) == 1 else "along"
    )


def refined(rows: np.ndarray, step: float) -> np.ndarray:
    """Rows (m, …, d) with linear ones put in between, so that no point moves farther than `step` from row to row."""
    travel = np.linalg.norm(np.diff(rows, axis=0), axis=-1).reshape(len(rows) - 1, -1).max(1)
    counts = np.maximum(1, np.ceil(travel / step - 1e-9)).astype(int)
    segment = np.repeat(np.arange(len(counts)), counts)
    fraction = (np.arange(len(segment)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[segment]
    fraction = fraction.reshape(-1, *[1] * (rows.ndim - 1))
    return np.concatenate([rows[segment] * (1 - fraction) + rows[segment + 1] * fraction, rows[-1:]])


def crossing(path: np.ndarray, solid: Solid) -> np.ndarray:
    """Where the polyline `path` (m, 3) first passes through the surface of `solid`: a point (3,).

    Every segment against every triangle (Möller and Trumbore, 1997). Raises ValueError where they do not meet.
    """
    origin, direction = path[:-1, None], np.diff(path, axis=0)[:, None]  # (s, 1, 3)
    a, b, c = (solid.vertices[solid.faces[:, k]] for k in range(3))  # (f, 3)
    across = np.cross(direction, c - a)
    determinant = np.einsum("sfk,fk->sf", across, b - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = np.einsum("sfk,sfk->sf", origin - a, across) / determinant
        lever = np.cross(origin - a, b - a)
        v = (lever * direction).sum(-1) / determinant
        t = np.einsum("sfk,fk->sf", lever, c - a) / determinant
        slack = 1e-9  # a path may run exactly through an edge that two triangles share
        hit = (u >= -slack) & (v >= -slack) & (u + v <= 1 + slack) & (t >= 0) & (t <= 1)
    if not hit.any():
        raise ValueError(
            "crossing: expected a path that enters the solid, got one that stays on one side; change the proportions"
        )
    along = np.where(hit, t + np.arange(len(path) - 1)[:, None], np.inf).min()
    segment = min(int(along), len(path) - 2)
    return path[segment] + (along - segment) * (path[segment + 1] - path[segment])


def _split(quads: np.ndarray, flip: np.ndarray) -> np.ndarray:
    """Two triangles a quad (q, 4): along the diagonal 0–2, or 1–3 where `flip` (q,)."""
    straight, turned = quads[:, [0, 1, 2, 0, 2, 3]], quads[:, [1, 2, 3, 1, 3, 0]]
    return np.where(flip[:, None], turned, straight).reshape(-1, 3)


def _outward(vertices: np.ndarray, faces: np.ndarray) -> Solid:
    a, b, c = (vertices[faces[:, k]] - vertices.mean(0) for k in range(3))
    volume = np.einsum("fk,fk->", a, np.cross(b, c))
    return Solid(vertices, faces if volume > 0 else faces[:, ::-1])
