"""What a keypoint head sees of a shape, and what it is to answer on a shot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from b23d.stages.solvers.scaling import FeatureScale, relative_distances, scale_features
from b23d.stages.solvers.shots import KnownShape, Shot


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
    one: KnownShape, how: FeatureScale, context: float
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Inputs (n, input) of a shape's candidates, and their distances (n, n) in units of the largest, +inf where no path
    joins two.

    An input is the scaled feature, followed, where context > 0, by the mean feature of the geodesic neighbourhood:
    weights exp(−d² / 2 context²), the point itself included.
    """
    own = scale_features(one.features.features, how, one.features.observed)
    distances = relative_distances(one.distances.distances)
    lengths = distances.relative
    if distances.unreachable is not None:
        lengths[distances.unreachable] = np.inf
    if context == 0:
        return own, lengths
    weights = gaussian(lengths, context)
    return np.concatenate([own, weights @ own / weights.sum(1, keepdims=True)], axis=1), lengths


def example(shot: Shot, how: FeatureScale, context: float, sigma: float) -> Example:
    """A shot with its heat maps exp(−d² / 2 sigma²), d from the keypoint's candidate."""
    inputs, lengths = shape_inputs(shot, how, context)
    return Example(inputs, shot.keypoints.ids, gaussian(lengths[:, shot.at], sigma))


def gaussian(lengths: np.ndarray, sigma: float) -> npt.NDArray[np.float32]:
    """exp(−d² / 2σ²), 0 where d is +inf."""
    return np.exp(-0.5 * (lengths / np.float32(sigma)) ** 2).astype(np.float32)
