"""Labels by the vote of the nearest neighbours in feature space."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from b23d.schemas.features import PointFeatures
from b23d.stages.solvers.scaling import FeatureScale, scale_features


def directions(reweight: PointFeatures, how: FeatureScale) -> npt.NDArray[np.float32]:
    """Scaled features of a shape's n candidates, each divided by its length: (n, channel) float32; zeros stay
    zeros."""
    scaled = scale_features(reweight.features, how, reweight.observed)
    lengths = np.linalg.norm(scaled, axis=1, keepdims=True)
    return np.divide(scaled, lengths, out=np.zeros_like(scaled), where=lengths > 0)


def vote(
    target: np.ndarray,
    known: np.ndarray,
    labels: np.ndarray,
    parts: int,
    k: int,
    weighting: Literal["similarity", "uniform"],
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float32]]:
    """The label with the largest sum of votes among the k nearest of `known` by cosine, and its share of all votes.

    target: (n, channel), known: (m, channel), both of length 1 or 0. labels: (m,) int in 0 … parts − 1.
    Returns (n,) int32 and (n,) float32. A vote weighs 1 + cosine ("similarity"), or 1.
    """
    cosines = target @ known.T  # (n, m)
    k = min(k, len(known))
    nearest = np.argpartition(-cosines, k - 1, axis=1)[:, :k]
    weights = np.ones(nearest.shape)
    if weighting == "similarity":
        weights = np.maximum(1 + np.take_along_axis(cosines, nearest, axis=1).astype(np.float64), 0)
    rows = np.arange(len(target))[:, None] * parts
    votes = np.bincount((rows + labels[nearest]).ravel(), weights.ravel(), minlength=len(target) * parts).reshape(
        len(target), parts
    )
    best = votes.argmax(1)
    total = votes.sum(1)
    share = np.divide(votes[np.arange(len(votes)), best], total, out=np.zeros(len(votes)), where=total > 0)
    return best.astype(np.int32), share.astype(np.float32)
