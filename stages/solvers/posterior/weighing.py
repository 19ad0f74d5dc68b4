"""The shots' model for one target: their observations, each counted as often as its shot does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.schemas.shot_model import ShotModel
from b23d.stages.solvers.nearness import effective
from b23d.stages.solvers.posterior.geometry import THINNEST

FAR = 1e-6
"""Weight of a shot unlike the target beside one that is like it: it decides where it alone has an id."""


@dataclass(frozen=True)
class Weighed:
    """k ids that a shot of any weight has; the rest of the shots' model is as it is for every target."""

    model: ShotModel
    shots: np.ndarray
    """(all shots,) weight of each that has keypoints; 0 of others."""
    has: np.ndarray
    """(s, k) bool, of shots of any weight."""
    counts: np.ndarray
    """(k,) how many examples there are of each id."""
    occurrence: np.ndarray
    """(k,) share of the shots like the target that have it, 0 … 1."""
    keypoint: np.ndarray
    """(descriptor,) discriminant "is a keypoint"."""
    identity: np.ndarray
    """(k, descriptor) discriminants "is this keypoint rather than another"."""
    places: np.ndarray
    """(k, 3) mean place in the box."""
    shifts: np.ndarray
    """(k, 3 r) mean shift vectors."""
    shift_squares: np.ndarray
    """(k, 3 r) summed squared deviations from such means."""
    deviating: np.ndarray
    """(k,) of how many shots."""
    distances: np.ndarray
    """(k, k) mean relative geodesic distances, where `pairs`."""
    pairs: np.ndarray
    deviations: np.ndarray
    """(k, k) covariance, for each axis, of the deviations from the mean places."""
    log_sides: np.ndarray
    """(3,) mean logarithm of the boxes' sides."""


def weighed(model: ShotModel, weights: np.ndarray, near: np.ndarray | None = None) -> Weighed:
    """weights: (s,) not negative, at least one that has keypoints above 0. near: (s,) 0 … 1, by which they are
    multiplied for where keypoints are, not for how they look; None: as if all 1. Where only shots far from the target
    have an id, those decide."""
    counted = weights[:, None] * model.has
    of, shown = np.flatnonzero(weights), np.flatnonzero(counted.any(0))
    weight, has = counted[np.ix_(of, shown)], model.has[np.ix_(of, shown)]
    counts = weight.sum(0)
    close = weights[of] if near is None else weights[of] * (near[of] + FAR)
    nearby = close[:, None] * has

    def mean(values: np.ndarray, weight: np.ndarray = nearby) -> np.ndarray:
        """(k, d) of values (s, k, d)."""
        return np.asarray(np.einsum("sk,skd->kd", weight, values[of][:, shown]) / weight.sum(0)[:, None])

    described = mean(model.descriptors, weight)
    centre = counts @ described / counts.sum()
    distances, pairs = mean_distances(model.distances[of][:, shown][:, :, shown], has, close)
    sides = np.log(np.maximum(model.sides[of], THINNEST))
    return Weighed(
        model=model,
        shots=weights * model.has.any(1),
        has=has,
        counts=counts,
        occurrence=_occurrence(has, close, weights[of]),
        keypoint=np.linalg.solve(model.covariance, centre),
        identity=np.linalg.solve(model.covariance, (described - centre).T).T,
        places=mean(model.places),
        shifts=mean(model.shifts),
        shift_squares=model.shift_squares[shown],
        deviating=model.deviating[shown],
        distances=distances,
        pairs=pairs,
        deviations=model.deviations[np.ix_(shown, shown)],
        log_sides=np.average(sides, axis=0, weights=weights[of] * has.any(1)),
    )


def _occurrence(has: np.ndarray, near: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(k,) of has (s, k): the share of the near shots, with that of all as half a shot more."""
    known = has.any(1)
    shares = [(wide[known] / wide[known].sum()) @ has[known] for wide in (near, weights)]
    several = effective(near[known])
    return np.asarray((several * shares[0] + shares[1] / 2) / (several + 1 / 2))


def mean_distances(distances: np.ndarray, has: np.ndarray, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(k, k) weighted mean over the shots that have both ids of a pair, and (k, k) bool, which pairs some shot has.

    distances (s, k, k) in the shots' largest; where no path joins two, they count as that.
    """
    both = has[:, :, None] & has[:, None]
    near = np.where(np.isfinite(distances), distances, 1) * both
    times = np.einsum("s,sij->ij", weights, both)
    total = np.einsum("s,sij->ij", weights, near)
    mean = np.divide(total, times, out=np.zeros_like(total), where=times > 0)
    return mean, (times > 0) & ~np.eye(len(mean), dtype=bool)
