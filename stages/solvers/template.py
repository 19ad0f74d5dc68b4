"""What several labelled shapes say about keypoints: their features and mutual distances, averaged per id and per
pair."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from b23d.schemas.shot_model import ShotModel


@dataclass(frozen=True)
class Template:
    """What to look for.

    ids: (k,) int32, sorted, every id that a shot of any weight has.
    features: (k, channel) float32.
    distances: (k, k) float64; 0 where `mask` is false.
    mask: (k, k) bool: pairs that enter the distance term.
    counts: (k,) float64, how many shots have each id: the sum of their weights.
    of: how many shots there are, so counted.
    shots: names of the shots it was made of.
    """

    ids: np.ndarray
    features: np.ndarray
    distances: np.ndarray
    mask: np.ndarray
    counts: np.ndarray
    of: float
    shots: list[str]


def template_of(model: ShotModel, weights: np.ndarray) -> Template:
    """The template of the shots, each counted `weights` (s,) times: features averaged over the shots that have an id,
    distances over those that have both ids of a pair and a path between them.

    combine "sum_distances": distances are summed instead of averaged, as the published code does.
    mask "pairs": every pair of different ids that some shot has. "positive": entries of the combined matrix above zero,
    as the published code does; that drops pairs that coincide. "whole": as "pairs", and the diagonal, as the paper's
    formula has it.
    """
    used, shown = np.flatnonzero(weights), np.flatnonzero(weights @ model.has)
    weight, has = weights[used], model.has[np.ix_(used, shown)]
    counts = weight @ has
    features = np.einsum("s,skc->kc", weight, model.features[used][:, shown]) / counts[:, None]
    between = model.distances[used][:, shown][:, :, shown].astype(np.float64)
    seen = has[:, :, None] & has[:, None] & np.isfinite(between)
    if model.distance_scale == "unit-frame":
        between *= model.largest[used, None, None]
    distances = np.einsum("s,sij->ij", weight, np.where(seen, between, 0))
    times = np.einsum("s,sij->ij", weight, seen)
    if model.combine == "mean":
        distances = np.divide(distances, times, out=np.zeros_like(distances), where=times > 0)
    diagonal = np.eye(len(shown), dtype=bool)
    keep = {"pairs": (times > 0) & ~diagonal, "positive": distances > 0, "whole": times > 0}[model.mask]
    return Template(
        model.ids[shown],
        features.astype(np.float32),
        np.where(keep, distances, 0),
        keep,
        counts,
        float(weight.sum()),
        [model.shots[i] for i in used],
    )


def check_combinable(ids: Sequence[np.ndarray]) -> None:
    """Raise ValueError where shots with these ids each cannot be combined: of several, no two share one."""
    occurrences = np.unique(np.concatenate(ids), return_counts=True)[1]
    if len(ids) > 1 and occurrences.max() < 2:
        listed = "; ".join(f"shot {i}: {sorted(map(int, one))}" for i, one in enumerate(ids))
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
