"""Labelled shapes with features and distances made up for tests, as the stages take them."""

from __future__ import annotations

import numpy as np

from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.parts import Parts
from b23d.schemas.shape import NormalizedShape

CENTER, SCALE = (1.0, -2.0, 0.5), 3.0
"""Of every shape made here: annotations stand in the source frame."""


def cloud(points: np.ndarray) -> NormalizedShape:
    """A cloud whose candidates are `points` (n, 3), unit frame."""
    n, points = len(points), points.astype(np.float32)
    return NormalizedShape(
        kind="cloud",
        vertices=points,
        faces=np.zeros((0, 3), np.int32),
        points=points,
        point_faces=np.full(n, -1, np.int32),
        point_barycentrics=np.zeros((n, 3), np.float32),
        candidates="cloud",
        center=CENTER,
        scale=SCALE,
        repairs={},
    )


def source(points: np.ndarray) -> np.ndarray:
    """Unit frame → source frame, float64."""
    return points.astype(np.float64) * SCALE + np.array(CENTER)


def described(features: np.ndarray) -> PointFeatures:
    n = len(features)
    return PointFeatures(
        features=features.astype(np.float16),
        counts=np.ones(n, np.int32),
        observed=np.ones(n, bool),
        descriptor="made up",
    )


def apart(points: np.ndarray) -> GeodesicDistances:
    """Straight distances."""
    lengths = np.linalg.norm(points[:, None] - points[None], axis=2)
    return GeodesicDistances(
        distances=lengths.astype(np.float16), components=np.zeros(len(points), np.int32), method="straight"
    )


def labelled(points: np.ndarray, labels: np.ndarray, names: list[str]) -> Parts:
    return Parts(points=source(points), labels=labels.astype(np.int32), names=names)


def keypointed(points: np.ndarray, ids: list[int], at: list[int]) -> Keypoints:
    return Keypoints(
        ids=np.array(ids, np.int32), positions=source(points[at]).reshape(-1, 3), point_indices=np.array(at, np.int32)
    )
