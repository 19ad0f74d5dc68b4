"""Scales of features and distances that carry over between encoders and shapes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from b23d.schemas.shot_model import FeatureScale


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


@dataclass(frozen=True)
class Relative:
    """Distances of one shape in units of its largest."""

    relative: npt.NDArray[np.float32]
    """(n, n), 0 … 1 (the paper's relative distances); 1 where no path joins two candidates."""
    largest: float
    """The largest finite one, in the unit frame; 1 where all candidates coincide."""
    unreachable: npt.NDArray[np.bool_] | None
    """(n, n); None where every candidate is reached from every other."""


def relative_distances(distances: np.ndarray) -> Relative:
    """Of distances (n, n) of any float dtype, in the unit frame, +inf where no path joins two candidates."""
    unreachable = np.isinf(distances) if np.isinf(_largest(distances)) else None
    largest = _largest(distances if unreachable is None else np.where(unreachable, 0, distances)) or 1.0
    relative = distances.astype(np.float32)
    relative /= np.float32(largest)
    if unreachable is not None:
        relative[unreachable] = 1
    return Relative(relative, largest, unreachable)


def _largest(distances: np.ndarray) -> float:
    """Of numbers that are not negative. Of half precision by their bits, which are in the same order and compared
    twenty times as fast."""
    if distances.dtype == np.float16 and distances.flags.c_contiguous and distances.size:
        bits = distances.view(np.uint16).max()
        if bits < 0x8000:  # no minus zero among them
            return float(bits.view(np.float16))
    return float(distances.max(initial=0))
