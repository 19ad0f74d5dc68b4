"""Clouds whose salient points are known, and detect calibrated on one of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from b23d.schemas.features import GeodesicDistances
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.predictions import Prediction
from b23d.schemas.shape import NormalizedShape
from b23d.stages.calibrate import CalibrateParams, calibrate
from b23d.stages.detect import DetectParams, detect
from b23d.stages.geodesic import GeodesicParams, geodesic
from tests.made_params import placed
from tests.made_shapes import of_cloud

Shot = tuple[NormalizedShape, GeodesicDistances, Keypoints]


def annotated(shape: NormalizedShape, places: Any) -> Shot:
    """A shape with keypoints at places of the unit frame."""
    places = np.asarray(places, float)
    source = places * shape.scale + shape.center
    keypoints = Keypoints(
        ids=np.arange(len(places), dtype=np.int32), positions=source, point_indices=np.full(len(places), -1, np.int32)
    )
    return shape, geodesic(shape, GeodesicParams()), keypoints


def run(shot: Shot, target: Shot | None = None, **params: Any) -> Prediction:
    shape, distances, _ = target or shot
    detector = calibrate([shot[0]], [shot[1]], [shot[2]], placed(CalibrateParams, **params))
    return detect(shape, distances, detector, DetectParams())


def grid_cube(side: int = 13) -> tuple[np.ndarray, np.ndarray]:
    """A cube's surface as a cloud, not on a lattice, and its corners; unit frame."""
    line = np.linspace(-0.5, 0.5, side)
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    points = grid[np.abs(grid).max(axis=1) == 0.5]
    free = np.abs(points) < 0.5
    return points + np.random.default_rng(0).uniform(-0.02, 0.02, points.shape) * free, points[(~free).all(axis=1)]


def nearest(found: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    return np.linalg.norm(found[:, None] - wanted[None], axis=2).min(axis=0)


CENTRES, HEIGHTS = np.array([[-0.25, -0.2], [0.2, 0.25], [0.25, -0.25]]), np.array([0.06, 0.07, 0.08])
TOPS = np.column_stack([CENTRES, HEIGHTS])


def hills(seed: int = 0) -> np.ndarray:
    """A square with three oblong hills, as a cloud with their tops at its end."""
    places = np.concatenate([np.random.default_rng(seed).uniform(-0.5, 0.5, (1200, 2)), CENTRES])
    x, y = np.moveaxis(places[:, None] - CENTRES, 2, 0)
    return np.column_stack([places, np.exp(-(x**2) / (2 * 0.07**2) - y**2 / (2 * 0.035**2)) @ HEIGHTS])


def hills_with_tops(seed: int = 0) -> Shot:
    shape = of_cloud(hills(seed))
    return annotated(shape, (TOPS - shape.center) / shape.scale)
