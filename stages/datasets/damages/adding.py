"""Damages that add what is no surface: outliers far off, points that fly near the surface."""

from __future__ import annotations

import numpy as np

from b23d.stages.datasets.damages.scan import Scan

REACH = 3.0
"""Side of the box that outliers lie in, in sizes."""
NEAR, FAR = 0.02, 0.2
"""How far from the surface points fly, in sizes."""
SPECK = 0.005
"""Side of the faces that are a mesh's stray points, in sizes."""


def outliers(scan: Scan, amount: float, rng: np.random.Generator) -> Scan:
    """Further points, `amount` of those there are (of a mesh specks, `amount` of its faces), anywhere in a box around
    the shape that is three times its size."""
    middle = (scan.vertices.min(axis=0) + scan.vertices.max(axis=0)) / 2
    count = round(amount * len(scan.places()))
    return _with(scan, middle + REACH * scan.size * (rng.random((count, 3)) - 0.5), rng)


def flying(scan: Scan, amount: float, rng: np.random.Generator) -> Scan:
    """Further points, `amount` of those there are (of a mesh specks, `amount` of its faces), that float off the surface
    in any direction, by 2 to 20 % of the size."""
    places, weights = scan.places(), scan.weights()
    count = round(amount * len(places))
    away = rng.normal(size=(count, 3))
    away *= (rng.uniform(NEAR, FAR, (count, 1)) * scan.size) / np.linalg.norm(away, axis=1, keepdims=True)
    return _with(scan, places[rng.choice(len(places), count, p=weights)] + away, rng)


def _with(scan: Scan, points: np.ndarray, rng: np.random.Generator) -> Scan:
    """The scan, and these points (n, 3): of a mesh each a speck of a face of its own."""
    if not len(scan.faces):
        return Scan(np.concatenate([scan.vertices, points]), scan.faces)
    corners = points[:, None] + SPECK * scan.size * rng.uniform(-0.5, 0.5, (len(points), 3, 3))
    faces = len(scan.vertices) + np.arange(3 * len(points)).reshape(-1, 3)
    return Scan(np.concatenate([scan.vertices, corners.reshape(-1, 3)]), np.concatenate([scan.faces, faces]))
