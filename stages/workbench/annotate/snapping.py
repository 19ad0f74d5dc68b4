"""From a place that was nearly meant to the one that was: the surface beside a ray, the tip beside a place."""

from __future__ import annotations

import numpy as np

TIP = 0.06
"""How far from a click its extremity is looked for, unit frame."""


def nearest_to_ray(
    start: np.ndarray, along: np.ndarray, corners: np.ndarray, within: float
) -> tuple[int, np.ndarray] | None:
    """The place of a mesh that looks nearest to a ray which misses it: its face and barycentrics there.

    `corners` (f, 3, 3), one frame with `start`; `along` has unit length; `within`: the most that the place may lie
    beside the ray, for each unit that it is away. None where nothing does. What lies nearest to a line that a triangle
    does not meet lies on an edge: edges alone are measured.
    """
    a = corners.reshape(-1, 3) - start  # (3 f, 3): the edge from each corner to the next
    edge = np.roll(corners, -1, axis=1).reshape(-1, 3) - start - a
    flat, flat_edge = a - np.outer(a @ along, along), edge - np.outer(edge @ along, along)  # seen along the ray
    length = np.einsum("ex,ex->e", flat_edge, flat_edge)
    t = np.clip(-np.einsum("ex,ex->e", flat, flat_edge) / np.where(length > 0, length, 1), 0, 1)
    places = a + t[:, None] * edge
    far = places @ along
    beside = np.linalg.norm(flat + t[:, None] * flat_edge, axis=1)
    slope = np.where(far > 0, beside / np.where(far > 0, far, 1), np.inf)
    found = int(slope.argmin())
    if not slope[found] <= within:
        return None
    face, corner = divmod(found, 3)
    barycentrics = np.zeros(3)
    barycentrics[corner], barycentrics[(corner + 1) % 3] = 1 - t[found], t[found]
    return face, barycentrics


def extremity(place: np.ndarray, points: np.ndarray) -> int | None:
    """Which of `points` (n, 3) within `TIP` of a place lies farthest from the shape's centre, the unit frame's origin;
    None where none is there or the place itself lies farther. On a mesh it is one of the vertices: nothing else of a
    face lies farther out than all its corners."""
    near = np.flatnonzero(np.linalg.norm(points - place, axis=1) <= TIP)
    if not len(near):
        return None
    out = np.linalg.norm(points[near], axis=1)
    return int(near[out.argmax()]) if out.max() > np.linalg.norm(place) else None
