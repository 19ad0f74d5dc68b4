"""reweight: Gaussian geodesic re-weighting of point features (the paper's Eq. 1), and features for points that no view
saw."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import Field

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.params import Params

HALF = float(np.finfo(np.float16).max)
UNDERFLOW = 14.5
"""Standard deviations beyond which a Gaussian weight is zero in float32, subnormal numbers included."""
NOTHING = -70.0
"""Exponents of weights that are nothing beside a weight of 1, nor is their product with a feature."""
SPARSE = 0.05
"""Share of the weights up to which a sparse product is faster than a full one."""


class ReweightParams(Params):
    sigma: float = Field(default=0.01, ge=0)
    """Standard deviation of the weight exp(-d² / 2σ²), a length in the unit frame (2,048 candidates lie about 0.015
    apart). 0 smooths nothing and only fills, with the nearest seen point's features."""
    normalised: bool = True
    """Divide by the sum of the weights (Eq. 1). False (the released code): only by the point's own share, so that
    crowded places come out larger; one factor a shape keeps the mean gain at 1."""
    weight: Literal["point", "views"] = "point"
    """What a seen point counts for: "point" once (Eq. 1), "views" by the number of views that saw it (the released
    code)."""
    fill: Literal["geodesic", "zeros"] = "geodesic"
    """Points no view saw: "geodesic" weights the seen points in the log domain, so that far ones take their nearest
    seen point's features; "zeros" computes the weights as they are in float32, whose underflow leaves far points at
    zero (the released code)."""
    batches: int = Field(default=1, ge=1)
    """View batches after each of which the running sum is smoothed once more (the released loop, where it is the number
    of views over the batch size). Only sums over all views are stored, so every batch is taken to have brought an equal
    share."""


@stage(version=1, hints=Hints(memory_gb=0.5))
def reweight(backproject: PointFeatures, geodesic: GeodesicDistances, params: ReweightParams) -> PointFeatures:
    """Smooth features along the surface and fill the points no view saw: f_i = Σ_j w(d_ij) f_j / Σ_j w(d_ij) over seen
    j.

    Linear in the features, once, after all views: the result does not depend on how the views were batched. `observed`,
    `counts` and `class_token` stay as they were. A part from which no seen point can be reached (only where `geodesic`
    left infinite distances) takes the mean of all seen points.

    Raises ValueError where no view saw any point, where the two inputs disagree about the candidates, or where
    un-normalised sums exceed half precision.
    """
    seen = backproject.observed
    distances = geodesic.distances
    if len(distances) != len(seen):
        raise ValueError(
            f"geodesic distances: expected {len(seen)} candidates, got {len(distances)}; use those of the same shape"
        )
    if not seen.any():
        raise ValueError(
            "features: expected at least one candidate that a view saw, got none; check views and visibility tolerance"
        )
    masses = np.where(seen, backproject.counts if params.weight == "views" else 1, 0).astype(np.float32)  # (n,)
    features = np.where(seen[:, None], backproject.features, 0).astype(np.float32)  # (n, c)
    smoothed = _smooth(distances, features, masses, params) if params.sigma else features
    if params.fill == "geodesic" and not seen.all():
        between = distances[np.ix_(~seen, seen)].astype(np.float32)
        weights = _relative_weights(between, params.sigma) * masses[seen]
        smoothed[~seen] = weights @ features[seen] / weights.sum(axis=1, keepdims=True)
    largest = float(np.abs(smoothed).max(initial=0))
    if not largest <= HALF:
        raise ValueError(
            f"smoothed features: expected at most {HALF:.0f}, which float16 holds, got {largest:.3g}; lower sigma or "
            "batches, or normalise"
        )
    return PointFeatures(
        features=smoothed.astype(np.float16),
        counts=backproject.counts,
        observed=seen,
        class_token=backproject.class_token,
        descriptor=backproject.descriptor,
    )


def _smooth(distances: np.ndarray, features: np.ndarray, masses: np.ndarray, params: ReweightParams) -> np.ndarray:
    """(n, c) float32: the weighted sum of the seen points' features at every point; zero where all its weights
    underflow."""
    weights = _weights(distances, params.sigma, _reach(masses, params))
    share, sums = masses / params.batches, features * (masses / params.batches)[:, None]
    total, reached = np.zeros_like(features), np.zeros_like(masses)
    for _ in range(params.batches):
        total, reached = weights @ (total + sums), weights @ (reached + share)
    if params.normalised:
        return np.divide(total, reached[:, None], out=np.zeros_like(total), where=reached[:, None] > 0)
    own = np.where(masses > 0, masses, masses[masses > 0].mean())
    gain = reached[masses > 0].sum() / masses.sum()
    return total / (gain * own)[:, None]


def _reach(masses: np.ndarray, params: ReweightParams) -> float:
    """Standard deviations beyond which weights may be left out.

    Where every point that keeps its sum has its own weight of 1 in it, all that is left out is less than 2⁻¹⁶ of that,
    a fraction of float16's rounding. Where points have none ("zeros" keeps the sums of unseen ones, and so does a loop
    of several batches), only what is zero in float32 is left out.
    """
    if params.fill == "zeros" or params.batches > 1:
        return UNDERFLOW
    ratio = float(masses.sum() / masses[masses > 0].min())
    return float(np.sqrt(2 * np.log(ratio * 2**16)))


def _weights(distances: np.ndarray, sigma: float, reach: float) -> Any:
    """(n, n) float32 Gaussian weights of float16 distances: sparse where most are beyond `reach` σ, else full."""
    from scipy.sparse import csr_array

    limit = np.float16(min(reach * sigma, HALF))
    # a half float that is not negative orders as the integer of the same bits, and numpy compares integers faster
    near = distances.view(np.uint16) <= np.nextafter(limit, np.float16(np.inf)).view(np.uint16)
    counts = near.sum(axis=1)
    if counts.sum() > SPARSE * near.size:
        exponents = (distances.astype(np.float32) / np.float32(sigma)) ** 2 / -2
        if reach < UNDERFLOW:  # far below what is rounded away, but processors take long over such small numbers
            exponents[exponents < NOTHING] = -np.inf
        return np.exp(exponents)
    at = np.flatnonzero(near)
    weights = np.exp((distances.ravel()[at].astype(np.float32) / np.float32(sigma)) ** 2 / -2)
    return csr_array((weights, at % len(distances), np.concatenate([[0], np.cumsum(counts)])), shape=distances.shape)


def _relative_weights(distances: np.ndarray, sigma: float) -> np.ndarray:
    """(u, s) float32 Gaussian weights of each row relative to its largest, which is 1: nothing underflows as a
    whole."""
    nearest = distances.min(axis=1, keepdims=True)
    if sigma == 0:
        weights = (distances == nearest).astype(np.float32)
    else:
        with np.errstate(invalid="ignore"):  # inf - inf in rows that reach nothing
            weights = np.exp(
                (nearest - distances) / np.float32(sigma) * ((nearest + distances) / np.float32(2 * sigma))
            )
    return np.where(np.isinf(nearest), np.float32(1), weights)
