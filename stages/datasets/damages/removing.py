"""Damages that take surface away: holes, what one side does not see, and most of the faces or points."""

from __future__ import annotations

import numpy as np

from b23d.stages.datasets.damages.scan import Scan
from b23d.stages.geodesics.connectivity import face_components

SIDE = 0.02
"""Longest side of the faces at a rim, in sizes."""
RADIUS = 0.08
"""Of a hole, in sizes."""
ELEVATION = 20.0
"""Degrees that a one-sided scan's camera looks down."""
DISTANCE = 3.0
"""Of that camera from the middle, in sizes."""
FLIP = 100.0
"""Radius of the sphere that hidden points are found with, in distances of the farthest point from the camera."""
AGGRESSIVENESS = (7, 4, 2, 1)
"""Of edge collapses, one after the other: how fast the error that is allowed grows."""


def holes(scan: Scan, amount: float, rng: np.random.Generator) -> Scan:
    """Balls around random places of the surface cut out, one after another, until `amount` (below 1) of it is gone."""
    fine = scan.fine(SIDE * scan.size)
    places, weights, size = fine.places(), fine.weights(), scan.size
    there = np.ones(len(places), bool)
    missing = amount
    while missing > 0 and there.sum() > 1:
        left = np.flatnonzero(there)
        centre = places[rng.choice(left, p=weights[left] / weights[left].sum())]
        distance = np.linalg.norm(places[left] - centre, axis=1)
        nearest = np.argsort(distance, kind="stable")
        enough = int(np.searchsorted(np.cumsum(weights[left][nearest]), missing))  # the last hole is smaller
        cut = left[nearest[: min(int((distance <= RADIUS * size).sum()), enough)]]
        if not len(cut):
            break
        there[cut] = False
        missing -= float(weights[cut].sum())
    return fine.of(there)


def one_sided(scan: Scan, amount: float, rng: np.random.Generator) -> Scan:
    """What a camera sees that looks down on the shape, `amount` degrees from its front (-z) towards its right (+x)."""
    fine = scan.fine(SIDE * scan.size)
    azimuth, elevation = np.deg2rad(amount), np.deg2rad(ELEVATION)
    direction = np.array([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), -np.cos(azimuth) * np.cos(elevation)])
    middle = (scan.vertices.min(axis=0) + scan.vertices.max(axis=0)) / 2
    eye = middle + DISTANCE * scan.size * direction
    return fine.of(_unhidden(fine, eye) if len(fine.faces) else _on_top(fine.vertices - eye))


def decimated(scan: Scan, amount: float, rng: np.random.Generator) -> Scan:
    """About `amount` faces, by collapsing edges of the least quadric error (Garland and Heckbert 1997), every part that
    hangs together by as much; of a cloud `amount` random points."""
    if not len(scan.faces):
        count = min(int(amount), len(scan.vertices))
        return scan.of(np.sort(rng.choice(len(scan.vertices), count, replace=False)))
    if len(scan.faces) <= amount:
        return scan
    group = np.unique(face_components(len(scan.vertices), scan.faces), return_inverse=True)[1].ravel()
    shares = np.bincount(group) / len(group)
    parts = [_simplified(scan.of(group == part), max(4, int(amount * share))) for part, share in enumerate(shares)]
    firsts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [part.faces + first for part, first in zip(parts, firsts, strict=False)]
    return Scan(np.concatenate([part.vertices for part in parts]), np.concatenate(faces))


def _simplified(part: Scan, count: int) -> Scan:
    """A part with about `count` faces. What resists at one aggressiveness yields at a lower; with several parts at once
    the others would be eaten up in its stead."""
    from fast_simplification import simplify

    vertices, faces = part.vertices, part.faces.astype(np.int32)
    for aggressiveness in AGGRESSIVENESS:
        if len(faces) > count:
            vertices, faces = simplify(vertices, faces, target_count=count, agg=aggressiveness)
    return Scan(np.asarray(vertices, np.float64), np.asarray(faces, np.int64))


def _unhidden(scan: Scan, eye: np.ndarray) -> np.ndarray:
    """(f,) bool: nothing lies between a face's middle and the eye."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    middle, size = scan.vertices.mean(axis=0), scan.size
    scene = EmbreeScene(robust=True)
    _mesh = TriangleMesh(scene, ((scan.vertices - middle) / size).astype(np.float32), scan.faces.astype(np.int32))
    places = (scan.places() - middle) / size
    to_eye = (eye - middle) / size - places
    to_eye /= np.linalg.norm(to_eye, axis=1, keepdims=True)
    hit = scene.run((places + 1e-4 * to_eye).astype(np.float32), to_eye.astype(np.float32), output=False)
    return np.asarray(hit) < 0


def _on_top(points: np.ndarray) -> np.ndarray:
    """(n,) bool: points (n, 3) that a camera at the origin sees, by hidden point removal (Katz, Tal and Basri 2007).

    Raises ValueError where all are in one plane with the camera.
    """
    from scipy.spatial import ConvexHull, QhullError

    distance = np.linalg.norm(points, axis=1, keepdims=True)
    flipped = points / distance * (2 * FLIP * distance.max() - distance)
    seen = np.zeros(len(points) + 1, bool)
    try:
        seen[ConvexHull(np.concatenate([flipped, np.zeros((1, 3))])).vertices] = True
    except QhullError as error:
        raise ValueError(
            "one-sided: expected points that the camera does not see edge-on, got all in one plane with it; set "
            "another dataset.damage.amount, or leave the shape out"
        ) from error
    return seen[:-1]
