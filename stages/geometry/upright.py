"""Which axis of a shape's file probably points up: a guess from flat undersides, for people to check."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

AXES = ("x", "y", "z")
LEVEL = 0.97
"""Cosine between a face's normal and the axis from which it counts as level (14°)."""
REACH = 0.02
"""A face stands on the ground if it lies within this part of the extent from the lowest place."""
CLEAR = 2.0
"""The best axis must have this many times the next one's support."""
LEAST = 0.02
"""Least share of its box's floor that a shape must stand on."""


@dataclass(frozen=True)
class Upright:
    """The guess for a set of shapes."""

    axis: str | None
    """`x`, `y` or `z`; None where the shapes do not tell."""
    votes: int
    """Shapes that say so."""
    asked: int


def support(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(3,) for each axis, how much of its box's cross-section level faces at either end fill, 0 … 1 or a little more.

    vertices (v, 3) float, faces (f, 3) int. A table or a mug stands on one end, and has level faces there.
    """
    corners = vertices[faces].astype(np.float64)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1) / 2
    sound = np.isfinite(area) & (area > 0)
    corners, normals, area = corners[sound], normals[sound], area[sound]
    if not len(area):
        return np.zeros(3)
    low, high = corners.min((0, 1)), corners.max((0, 1))
    extent = np.maximum(high - low, np.finfo(float).tiny)
    level = np.abs(normals) / (2 * area[:, None]) > LEVEL
    centroids = corners.mean(axis=1)
    found = np.zeros(3)
    for axis in range(3):
        section = np.prod(np.delete(extent, axis))
        for end in (centroids[:, axis] - low[axis], high[axis] - centroids[:, axis]):
            there = level[:, axis] & (end < REACH * extent[axis])
            found[axis] = max(found[axis], area[there].sum() / section)
    return found


def guess(supports: list[np.ndarray]) -> Upright:
    """The axis that most of the shapes stand on, if more than half of them say so."""
    votes = []
    for each in supports:
        order = np.argsort(each)
        if each[order[-1]] > LEAST and each[order[-1]] > CLEAR * each[order[-2]]:
            votes.append(int(order[-1]))
    counts = np.bincount(votes, minlength=3)
    best = int(counts.argmax())
    clear = counts[best] > len(supports) / 2
    return Upright(AXES[best] if clear else None, int(counts[best]) if clear else 0, len(supports))
