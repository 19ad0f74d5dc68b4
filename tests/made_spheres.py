"""A labelled sphere as learn and optimize take it, and both in one call."""

from __future__ import annotations

from typing import Any

import numpy as np

from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.predictions import Prediction
from b23d.schemas.shape import NormalizedShape
from b23d.stages.learn import learn
from b23d.stages.optimize import optimize
from tests.made_params import of_learn_and_optimize

Labelled = tuple[NormalizedShape, PointFeatures, GeodesicDistances, Keypoints]


def shape_of(points: np.ndarray, scale: float = 1.0) -> NormalizedShape:
    n = len(points)
    return NormalizedShape(
        kind="cloud",
        vertices=points.astype(np.float32),
        faces=np.zeros((0, 3), np.int32),
        points=points.astype(np.float32),
        point_faces=np.full(n, -1, np.int32),
        point_barycentrics=np.zeros((n, 3), np.float32),
        candidates="cloud",
        center=(0.0, 0.0, 0.0),
        scale=scale,
        repairs={},
    )


def features_of(features: np.ndarray, token: np.ndarray | None = None) -> PointFeatures:
    n = len(features)
    return PointFeatures(
        features=features.astype(np.float16),
        counts=np.ones(n, np.int32),
        observed=np.ones(n, bool),
        class_token=None if token is None else token.astype(np.float32),
        descriptor="test",
    )


def distances_of(distances: np.ndarray) -> GeodesicDistances:
    return GeodesicDistances(
        distances=distances.astype(np.float16), components=np.zeros(len(distances), np.int32), method="test"
    )


def keypoints_of(ids: list[int], indices: list[int], points: np.ndarray) -> Keypoints:
    return Keypoints(
        ids=np.array(ids, np.int32),
        positions=points[indices].astype(np.float64).reshape(-1, 3),
        point_indices=np.array(indices, np.int32),
    )


def sphere(seed: int, n: int = 200, channels: int = 12) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points on a sphere of diameter 1, smooth features of the position, great-circle distances."""
    random = np.random.default_rng(seed)
    directions = random.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    waves = np.random.default_rng(99).normal(size=(3, channels))
    angles = np.arccos(np.clip(directions @ directions.T, -1, 1))
    np.fill_diagonal(angles, 0)
    return directions / 2, np.sin(2 * directions @ waves) + 5, angles / 2


def labelled(seed: int, ids: list[int], indices: list[int], token: np.ndarray | None = None) -> Labelled:
    points, features, distances = sphere(seed)
    return shape_of(points), features_of(features, token), distances_of(distances), keypoints_of(ids, indices, points)


def solve(target: Labelled, shots: list[Labelled], **params: Any) -> Prediction:
    """The paper's objective by the discrete solver, unless told otherwise; the posterior method has its own tests."""
    teaching, search = of_learn_and_optimize(**{"method": "discrete", **params})
    model = learn(*(list(column) for column in zip(*shots, strict=True)), teaching)  # type: ignore[arg-type]
    return optimize(*target[:3], model, search)


IDS, AT = [0, 2, 5, 9], [3, 50, 120, 180]
