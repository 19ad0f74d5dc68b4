"""Which shots count for a target, and how much."""

from __future__ import annotations

import numpy as np

from b23d.schemas.features import PointFeatures
from b23d.schemas.shot_model import ShotModel


def weights_of(model: ShotModel, target: PointFeatures, retrieval: bool) -> np.ndarray:
    """(s,) how many times each shot counts: all once; or, by retrieval, only the one that looks most like the target
    (section 3.2 of the paper)."""
    if not retrieval:
        return np.ones(len(model.shots))
    return np.eye(len(model.shots))[most_alike(model, target)]


def most_alike(model: ShotModel, target: PointFeatures) -> int:
    """The shot, of those that have keypoints, whose class token has the largest cosine with the target's; the first of
    equals. Where any shape has no class token (SAM, EfficientNet, HKS …), mean features of observed points are compared
    instead."""
    own, shots = mean_feature(target), model.mean_features
    if model.class_tokens is not None and target.class_token is not None:
        own, shots = target.class_token, model.class_tokens
    alike = np.array([_cosine(own, shot) for shot in shots])
    return int(np.where(model.has.any(1), alike, -np.inf).argmax())


def mean_feature(shape: PointFeatures) -> np.ndarray:
    """(channel,) float32, of the points that some view saw; of all, where none did."""
    observed, features = shape.observed, shape.features
    return (features[observed] if observed.any() else features).mean(0, dtype=np.float64).astype(np.float32)


def _cosine(a: np.ndarray, b: np.ndarray) -> float:
    a, b = a.astype(np.float64), b.astype(np.float64)
    length = np.linalg.norm(a) * np.linalg.norm(b)
    return float(a @ b / length) if length > 0 else -1.0
