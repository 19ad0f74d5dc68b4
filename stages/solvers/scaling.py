"""Scales of features and distances that carry over between encoders and shapes."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

FeatureScale = Literal["raw", "centred", "centred-unit", "standardised"]
DistanceScale = Literal["largest", "unit-frame"]


def scale_features(
    features: np.ndarray, how: FeatureScale, observed: np.ndarray | None = None
) -> npt.NDArray[np.float32]:
    """Features of one shape's candidates, (n, channel) of any float dtype → (n, channel) float32, none of them
    dependent on other shapes.

    raw: as they are.
    centred: less the shape's mean feature.
    centred-unit: centred, then every point's feature divided by its length.
    standardised: every channel with zero mean and variance 1 / channel over the shape, so that a point's feature has
    length 1 on average.

    observed: (n,) bool, the points that mean and variance are taken over; None, or no point at all: every point.
    """
    scaled = features.astype(np.float32)
    if how == "raw":
        return scaled
    basis = scaled[observed] if observed is not None and observed.any() else scaled
    scaled -= basis.mean(0, dtype=np.float64).astype(np.float32)
    if how == "centred":
        return scaled
    if how == "centred-unit":
        sizes = np.linalg.norm(scaled, axis=1, keepdims=True)
    else:
        sizes = basis.std(0, dtype=np.float64).astype(np.float32) * np.sqrt(np.float32(scaled.shape[1]))
    return np.divide(scaled, sizes, out=np.zeros_like(scaled), where=sizes > 0)


def scale_distances(distances: np.ndarray, how: DistanceScale) -> npt.NDArray[np.float32]:
    """Distances of one shape, (n, n) of any float dtype, unit frame → (n, n) float32.

    largest: in units of the shape's largest finite distance, so 0 … 1 (the paper's relative distances).
    unit-frame: as they are.
    Unreachable pairs (+inf) stay +inf.
    """
    scaled = distances.astype(np.float32)
    if how == "largest":
        largest = largest_distance(scaled)
        if largest > 0:
            scaled /= np.float32(largest)
    return scaled


def largest_distance(distances: np.ndarray) -> float:
    """Largest finite distance; 0 where there is none."""
    largest = float(distances.max(initial=0))
    return largest if np.isfinite(largest) else float(distances.max(initial=0, where=np.isfinite(distances)))
