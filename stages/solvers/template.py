"""What several labelled shapes say about keypoints: their features and mutual distances, averaged per id and per
pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

Combine = Literal["mean", "sum_distances"]
Mask = Literal["pairs", "positive", "whole"]


@dataclass(frozen=True)
class AtKeypoints:
    """What one shot says, at its keypoints only.

    name: for messages and `Prediction.shots`.
    ids: (g,) int, unique.
    features: (g, channel) float32, scaled as the target's will be.
    distances: (g, g) float32, scaled as the target's will be; +inf where one keypoint cannot be reached from another.
    """

    name: str
    ids: np.ndarray
    features: np.ndarray
    distances: np.ndarray


@dataclass(frozen=True)
class Template:
    """What to look for.

    ids: (k,) int32, sorted, every id that any shot has.
    features: (k, channel) float32.
    distances: (k, k) float64; 0 where `mask` is false.
    mask: (k, k) bool: pairs that enter the distance term.
    counts: (k,) int, how many shots have each id.
    shots: names of the shots it was made of.
    """

    ids: np.ndarray
    features: np.ndarray
    distances: np.ndarray
    mask: np.ndarray
    counts: np.ndarray
    shots: list[str]


def combine_shots(shots: Sequence[AtKeypoints], combine: Combine = "mean", mask: Mask = "pairs") -> Template:
    """The template of some shots: features averaged over the shots that have an id, distances over those that have both
    ids of a pair.

    combine "sum_distances": distances are summed instead of averaged, as the published code does.
    mask "pairs": every pair of different ids that some shot has. "positive": entries of the combined matrix above zero,
    as the published code does; that drops pairs that coincide. "whole": as "pairs", and the diagonal, as the paper's
    formula has it.

    Raises ValueError where no shot has a keypoint, or where of several shots no two share an id.
    """
    check_combinable(shots)
    ids = np.unique(np.concatenate([shot.ids for shot in shots])).astype(np.int32)
    k, channels = len(ids), shots[0].features.shape[1]
    features = np.zeros((k, channels))
    counts = np.zeros(k, dtype=np.int64)
    distances = np.zeros((k, k))
    seen = np.zeros((k, k), dtype=np.int64)
    for shot in shots:
        rows = np.searchsorted(ids, shot.ids)
        reachable = np.isfinite(shot.distances)
        features[rows] += shot.features
        counts[rows] += 1
        distances[np.ix_(rows, rows)] += np.where(reachable, shot.distances, 0)
        seen[np.ix_(rows, rows)] += reachable
    features /= counts[:, None]
    if combine == "mean":
        distances /= np.maximum(seen, 1)
    keep = {"pairs": (seen > 0) & ~np.eye(k, dtype=bool), "positive": distances > 0, "whole": seen > 0}[mask]
    return Template(
        ids, features.astype(np.float32), np.where(keep, distances, 0), keep, counts, [shot.name for shot in shots]
    )


def check_combinable(shots: Sequence[AtKeypoints]) -> None:
    """Raise ValueError where these shots cannot be combined."""
    listed = "; ".join(f"shot {shot.name}: {sorted(map(int, shot.ids))}" for shot in shots)
    if not any(len(shot.ids) for shot in shots):
        raise ValueError(f"shots: expected at least one keypoint, got none ({listed or 'no shot'}); annotate the shots")
    occurrences = np.unique(np.concatenate([shot.ids for shot in shots]), return_counts=True)[1]
    if len(shots) > 1 and occurrences.max() < 2:
        raise ValueError(
            f"shots: expected an id that two of them share, got ids {listed}; use shots annotated with the same ids"
        )


def smooth_among(features: np.ndarray, distances: np.ndarray, sigma: float) -> np.ndarray:
    """Keypoint features (g, channel) averaged with Gaussian weights exp(−d² / 2σ²) of their mutual distances (g, g),
    both in one unit.

    The published code smooths a shot's features among its keypoints alone (method's row on source keypoints).
    """
    weights = np.exp(-0.5 * (distances.astype(np.float64) / sigma) ** 2)  # +inf weighs nothing, the point itself 1
    return (weights @ features / weights.sum(1, keepdims=True)).astype(np.float32)
