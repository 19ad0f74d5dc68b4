"""What a keypoint head sees of a shape, and what it is to answer on a shot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.shape import NormalizedShape
from b23d.stages.geometry.keypoints import keypoint_candidates
from b23d.stages.solvers.scaling import FeatureScale, scale_distances, scale_features


@dataclass(frozen=True)
class Example:
    """One shot.

    inputs: (n, input) float32.
    ids: (g,) int, unique.
    maps: (n, g) float32 in 0 … 1, 1 at each id's keypoint.
    """

    inputs: np.ndarray
    ids: np.ndarray
    maps: np.ndarray


def shape_inputs(
    name: str,
    shape: NormalizedShape,
    features: PointFeatures,
    distances: GeodesicDistances,
    how: FeatureScale,
    context: float,
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Inputs (n, input) of a shape's candidates, and their distances (n, n) in units of the largest, +inf where no path
    joins two.

    An input is the scaled feature, followed, where context > 0, by the mean feature of the geodesic neighbourhood:
    weights exp(−d² / 2 context²), the point itself included. Raises ValueError, naming the shape: not n of them, or not
    finite.
    """
    n = len(shape.points)
    if len(features.features) != n or len(distances.distances) != n:
        raise ValueError(
            f"{name}: expected features and distances of its {n} candidates, "
            f"got {len(features.features)} and {len(distances.distances)}; "
            "re-run reweight and geodesic"
        )
    if not np.isfinite(features.features).all():
        raise ValueError(
            f"{name}: expected finite features, got NaN or infinity ({features.descriptor}); check the descriptor"
        )
    own = scale_features(features.features, how, features.observed)
    lengths = scale_distances(distances.distances, "largest")
    if context == 0:
        return own, lengths
    weights = gaussian(lengths, context)
    return np.concatenate([own, weights @ own / weights.sum(1, keepdims=True)], axis=1), lengths


def example(
    name: str,
    shape: NormalizedShape,
    features: PointFeatures,
    distances: GeodesicDistances,
    keypoints: Keypoints,
    how: FeatureScale,
    context: float,
    sigma: float,
) -> Example:
    """A shot with its heat maps exp(−d² / 2 sigma²), d from the keypoint's candidate. Raises as `shape_inputs`, and for
    a keypoint beyond the cloud."""
    inputs, lengths = shape_inputs(name, shape, features, distances, how, context)
    at = keypoint_candidates(keypoints, shape, name) if len(keypoints.ids) else np.zeros(0, np.int64)
    return Example(inputs, keypoints.ids, gaussian(lengths[:, at], sigma))


def gaussian(lengths: np.ndarray, sigma: float) -> npt.NDArray[np.float32]:
    """exp(−d² / 2σ²), 0 where d is +inf."""
    return np.exp(-0.5 * (lengths / np.float32(sigma)) ** 2).astype(np.float32)


def check_examples(examples: list[Example]) -> None:
    """Raise ValueError where nothing can be learned from these shots."""
    if not any(len(one.ids) for one in examples):
        raise ValueError("shots: expected at least one keypoint, got none; annotate the shots")
    widths = sorted({one.inputs.shape[1] for one in examples})
    if len(widths) > 1:
        raise ValueError(
            f"shots: expected features with as many channels in every shot, got inputs of {widths}; "
            "use one encoder for all"
        )
