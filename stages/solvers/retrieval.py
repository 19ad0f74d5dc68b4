"""Retrieval: the one shot that looks most like the target, by class token (section 3.2 of the paper)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from b23d.schemas.features import PointFeatures


def retrieve(target: PointFeatures, shots: Sequence[PointFeatures]) -> int:
    """Index of the shot whose class token has the largest cosine with the target's; the first of equals.

    Where any of them has no class token (SAM, EfficientNet, HKS …), mean features of observed points are compared
    instead. Raises ValueError where they are not of one length.
    """
    shapes = [target, *shots]
    tokens = [token for shape in shapes if (token := shape.class_token) is not None]
    vectors = tokens if len(tokens) == len(shapes) else [_mean_feature(shape) for shape in shapes]
    if len({len(vector) for vector in vectors}) > 1:
        raise ValueError(
            f"retrieval: expected features of one length, got {[len(v) for v in vectors]}; use one encoder for all"
        )
    return int(np.argmax([_cosine(vectors[0], vector) for vector in vectors[1:]]))


def _mean_feature(shape: PointFeatures) -> np.ndarray:
    observed, features = shape.observed, shape.features
    return (features[observed] if observed.any() else features).mean(0, dtype=np.float64)


def _cosine(a: np.ndarray, b: np.ndarray) -> float:
    a, b = a.astype(np.float64), b.astype(np.float64)
    length = np.linalg.norm(a) * np.linalg.norm(b)
    return float(a @ b / length) if length > 0 else -1.0
