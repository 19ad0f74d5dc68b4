"""Where the keypoints are on a target: unary costs, a mean field over keypoints that move together, and the points of
most expected hits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from b23d.stages.solvers.calibration import log_odds
from b23d.stages.solvers.posterior.geometry import THINNEST, Prepared, descriptors, squared
from b23d.stages.solvers.posterior.neighbourhoods import told_by_neighbourhoods
from b23d.stages.solvers.posterior.options import PosteriorParams
from b23d.stages.solvers.posterior.weighing import Weighed

NEAR = 0.05  # a keypoint is found that is no farther off along the surface, in longest box sides
LOOKS, USUAL = 6.0, 0.35  # log-odds of presence that likeness is worth, and that of keypoints as likely there as not
IMPOSSIBLE = 1e-200  # less than this is not told apart
NEGLIGIBLE = 1e-9  # a candidate less probable than this for every keypoint adds nothing to expected hits


@dataclass(frozen=True)
class Found:
    """k keypoints."""

    points: npt.NDArray[np.int64]
    """(k,) candidates."""
    hits: np.ndarray
    """(k,) most expected hits by the mean field, 0 … 1: certain of it within the hit radius."""
    mass: np.ndarray
    """(k,) posterior of the candidates within `NEAR` of the chosen point along the surface, 0 … 1, whatever the front
    is."""
    present: npt.NDArray[np.bool_]
    """(k,) by the evidence of groups of ids that the same shots have."""
    front_margin: float | None = None
    """Nats of evidence by which the front that was taken beats the next best; None where none was looked for."""


def predict(learned: Weighed, near: np.ndarray, target: Prepared, params: PosteriorParams) -> Found:
    """Where the mean field expects most hits, shots' neighbourhoods are laid, the nearer ones', of near (s,); points
    are those of most expected hits by both. What is said of them, and of presence, is by the mean field alone."""
    posterior = mean_field(learned, target, unary_costs(learned, target, params), params)
    points, hits = most_hits(posterior, target, params)
    present = judged_present(learned, hits, alike(learned, target, posterior), params.present)
    told = told_by_neighbourhoods(learned, near, target, points)
    points = most_hits(_normalised(told - np.log(np.maximum(posterior, IMPOSSIBLE))), target, params)[0]
    return Found(points, hits, near_mass(posterior, target, points), present)


def most_hits(posterior: np.ndarray, target: Prepared, params: PosteriorParams) -> tuple[np.ndarray, np.ndarray]:
    """(k,) candidates of most expected hits by posterior (k, n), and these."""
    likely = np.flatnonzero(posterior.max(0) > NEGLIGIBLE)
    nearness = np.maximum(0, 1 - target.distances[likely] * np.float32(target.diameter / params.hit_radius))
    expected = posterior[:, likely].astype(np.float32) @ nearness
    points = expected.argmax(1)
    return points, expected[np.arange(len(points)), points]


def near_mass(posterior: np.ndarray, target: Prepared, points: np.ndarray) -> np.ndarray:
    """(k,) of posterior (k, n), of the candidates within `NEAR` of points (k,) along the surface."""
    around = target.distances[points] * np.float32(target.diameter) <= NEAR
    return np.asarray((posterior * around).sum(1))


def unary_costs(learned: Weighed, target: Prepared, params: PosteriorParams) -> np.ndarray:
    """(k, n) cost of each candidate by itself: by its looks, and by where the surface around it lies."""
    return shift_costs(learned, target, params) - looks(learned, target, params)


def alike(learned: Weighed, target: Prepared, posterior: np.ndarray) -> np.ndarray:
    """(k,) how much what is taken for a keypoint looks like it, by posterior (k, n): 0 as any point does, 1 as the
    shots' own do on average. It is the plain discriminant's mean over what it is of the shots' mean, which is a squared
    length (Mahalanobis)."""
    discriminant = learned.keypoint + learned.identity
    lengths = np.einsum("kd,de,ke->k", discriminant, learned.model.covariance, discriminant)
    seen = np.einsum("kn,nd->kd", posterior, _described(learned, target))
    return np.asarray((discriminant * seen).sum(1) / np.maximum(lengths, 1e-12))


def looks(learned: Weighed, target: Prepared, params: PosteriorParams) -> np.ndarray:
    """(k, n) how much each candidate looks like each keypoint, however the target is turned. The more examples of an
    id, the more they say of it by themselves."""
    further = np.maximum(learned.counts - 1, 0)[:, None]
    plain = further / (further + params.plain_after)
    keypoint, identity = (plain + (1 - plain) * w for w in (params.keypoint_weight, params.identity_weight))
    return np.asarray((keypoint * learned.keypoint + identity * learned.identity) @ _described(learned, target).T)


def shift_costs(learned: Weighed, target: Prepared, params: PosteriorParams) -> np.ndarray:
    """(k, n). Before shots show otherwise, the horizontal shift is trusted only as far as the frame is."""
    gate = np.tile([learned.model.gate, 1.0, learned.model.gate], len(learned.model.radii))
    squares = params.shift_worth * params.shift_sd**2 * gate + learned.shift_squares
    precision = (params.shift_worth + learned.deviating)[:, None] / squares
    own, wide = learned.shifts, target.shift.astype(np.float64)
    return np.asarray(((precision * own**2).sum(1)[:, None] - 2 * precision * own @ wide.T + precision @ wide.T**2) / 2)


def mean_field(learned: Weighed, target: Prepared, unary: np.ndarray, params: PosteriorParams) -> np.ndarray:
    """(k, n) posterior of each keypoint over the candidates: Gaussian deformation prior, unary costs, and geodesic
    distances to the others' present modes; keypoints are updated in turn (Bishop, Pattern Recognition, sec. 10.1)."""
    position = target.position.astype(np.float64)
    place, covariance = prior(learned, target)
    precision = np.linalg.inv(covariance)
    pull = learned.pairs * (params.distance_weight / (2 * params.distance_sd**2) / max(len(place) - 1, 1))
    posterior = _normalised(unary + squared(place, position) / (2 * np.diag(covariance)[:, None]))
    deviation, mode = posterior @ position - place, posterior.argmax(1)
    for _ in range(params.iterations):
        for i in range(len(place)):
            centre = place[i] - (precision[i] @ deviation - precision[i, i] * deviation[i]) / precision[i, i]
            cost = unary[i] + 0.5 * precision[i, i] * ((position - centre) ** 2).sum(1)
            cost += pull[i] @ (target.distances[mode] - learned.distances[i][:, None]) ** 2
            posterior[i] = _normalised(cost[None])[0]
            deviation[i], mode[i] = posterior[i] @ position - place[i], posterior[i].argmax()
    return posterior


def prior(learned: Weighed, target: Prepared) -> tuple[np.ndarray, np.ndarray]:
    """Where keypoints are expected (k, 3), and the covariance of their deviations, for each axis (k, k)."""
    return learned.places * np.maximum(target.sides, THINNEST), learned.deviations


def judged_present(learned: Weighed, hits: np.ndarray, alike: np.ndarray, least: float) -> npt.NDArray[np.bool_]:
    """Ids that the same shots have are decided together, by the odds of how often shots like the target have them, and
    by their mean expected hit and likeness. One shot alone keeps all its ids."""
    if len(learned.has) == 1:
        return np.ones(len(hits), bool)
    group = np.unique(learned.has, axis=1, return_inverse=True)[1].ravel()
    hit, look = ((np.bincount(group, values) / np.bincount(group))[group] for values in (hits, alike))
    odds = log_odds(learned.occurrence) + log_odds(hit) / 2 + LOOKS * (np.minimum(look, 1) - USUAL)
    return np.asarray(1 / (1 + np.exp(-odds)) >= least)


def _described(learned: Weighed, target: Prepared) -> np.ndarray:
    """(n, descriptor) standardised as the shots'."""
    model = learned.model
    return np.asarray((descriptors(target, model.basis) - model.mean) / model.scale)


def _normalised(costs: np.ndarray) -> np.ndarray:
    weights = np.exp(-(costs - costs.min(1, keepdims=True)))
    return np.asarray(weights / weights.sum(1, keepdims=True))
