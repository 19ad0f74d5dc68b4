"""A common frame for shapes that have none: shots are turned onto each other by their labels, targets by the evidence.
All turns are about the up axis, in radians, from +z towards +x."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from b23d.stages.solvers.posterior.geometry import THINNEST, Prepared, squared
from b23d.stages.solvers.posterior.options import PosteriorParams
from b23d.stages.solvers.posterior.predicting import mean_field, prior, unary_costs
from b23d.stages.solvers.posterior.weighing import Weighed

REFINED = 4  # local maxima of the first evidence that are followed up


def aligned(shots: list[Prepared], same_frame: float) -> tuple[list[Prepared], np.ndarray]:
    """The shots, turned onto the one that needs the least turning in all, and (s,) by which each was: 0 for those that
    stand as it does, within `same_frame` degrees."""
    pairs = np.array([[_turn(shot, reference, same_frame) for reference in shots] for shot in shots])
    turns = pairs[:, np.abs(pairs).sum(0).argmin()]
    return [turned(shot, turn) for shot, turn in zip(shots, turns, strict=True)], turns


def in_frame(learned: Weighed, target: Prepared, params: PosteriorParams) -> Prepared:
    """The target, turned to where the shots' model explains it best; as it is where all shots stood alike: then targets
    are taken to do so, too.

    Every turn is judged by each keypoint alone, the best few by the mean field's lower bound (Bishop, Pattern
    Recognition, sec. 10.1), with the box's proportions and a prior: as the shots stood, or any orientation.
    """
    if not learned.model.turns.any():
        return target
    angles = np.arange(params.turns) * (2 * np.pi / params.turns)
    candidates = [turned(target, angle) for angle in angles]
    stands = _log_prior(angles, learned.model.turns[learned.model.has.any(1)], params)
    stands -= np.array([((_log_sides(shape) - learned.log_sides) ** 2).sum() for shape in candidates]) / (
        2 * params.sides_sd**2
    )
    unaries = [unary_costs(learned, shape, params) for shape in candidates]
    alone = [_evidence(learned, shape, unary) for shape, unary in zip(candidates, unaries, strict=True)]
    first = stands + np.array(alone) / params.temper
    peaks = np.flatnonzero((first >= np.roll(first, 1)) & (first >= np.roll(first, -1)))
    peaks = peaks[np.argsort(-first[peaks], kind="stable")][:REFINED]
    bounds = [stands[i] + _bound(learned, candidates[i], unaries[i], params) / params.temper for i in peaks]
    return candidates[peaks[int(np.argmax(bounds))]]


def turned(shape: Prepared, angle: float) -> Prepared:
    """The shape turned about the up axis, in its new box. Invariant parts stay as they are, radii of the neighbourhoods
    included."""
    if angle == 0:
        return shape
    sin, cos = np.sin(angle), np.cos(angle)
    rotation = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]], np.float32)
    position = shape.position @ rotation.T
    low, high = position.min(0), position.max(0)
    scale = float((high - low).max()) or 1.0
    position = (position - (low + high) / 2) / scale
    sides = (high - low) / scale
    shift = (shape.shift.reshape(len(position), -1, 3) @ rotation.T).reshape(len(position), -1)
    box = position / np.maximum(sides, THINNEST)
    return replace(shape, position=position, sides=sides, box=box, shift=shift, diameter=shape.diameter / scale)


def _turn(shot: Prepared, reference: Prepared, same_frame: float) -> float:
    """The turn that brings a shot's keypoints onto the reference's of the same ids (Procrustes about one axis); 0 where
    it is small, or does not explain most of what parts them."""
    _, own, other = np.intersect1d(shot.ids, reference.ids, return_indices=True)
    if len(own) < 2:
        return 0.0
    a, b = (
        s.position[s.keypoints[i]][:, [2, 0]].astype(np.float64) for s, i in ((shot, own), (reference, other))
    )  # (z, x)
    a, b = a - a.mean(0), b - b.mean(0)
    angle = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    before, after = ((a - b) ** 2).sum(), ((a @ rotation.T - b) ** 2).sum()
    return angle if abs(angle) > np.deg2rad(same_frame) and after < before / 2 else 0.0


def _log_prior(angles: np.ndarray, turns: np.ndarray, params: PosteriorParams) -> np.ndarray:
    """(t,) log density, but for a constant: a mixture of one von Mises distribution a shot and, as heavy as one of
    them, a uniform one."""
    agreement = np.cos(angles[:, None] - turns[None])  # a target that stood as a shot needs that shot's turn
    peaks = np.exp(params.turn_concentration * (agreement - 1)) * np.sqrt(2 * np.pi * params.turn_concentration)
    return np.asarray(np.log(1 + peaks.sum(1)))


def _evidence(learned: Weighed, target: Prepared, unary: np.ndarray) -> float:
    """Log evidence with keypoints independent of each other."""
    place, covariance = prior(learned, target)
    costs = unary + squared(place, target.position.astype(np.float64)) / (2 * np.diag(covariance)[:, None])
    least = costs.min(1)
    return float((np.log(np.exp(least[:, None] - costs).sum(1)) - least).sum())


def _bound(learned: Weighed, target: Prepared, unary: np.ndarray, params: PosteriorParams) -> float:
    """Lower bound of the log evidence at the mean field: its entropy less its expected cost."""
    posterior = mean_field(learned, target, unary, params)
    place, covariance = prior(learned, target)
    precision = np.linalg.inv(covariance)
    position = target.position.astype(np.float64)
    mean = posterior @ position
    variance = (posterior @ position**2 - mean**2).sum(1)
    mode = posterior.argmax(1)
    pull = params.distance_weight / (2 * params.distance_sd**2) / max(len(place) - 1, 1)
    distances = ((target.distances[np.ix_(mode, mode)] - learned.distances) ** 2 * learned.pairs).sum() / 2
    deviation = mean - place
    cost = (posterior * unary).sum() + pull * distances
    cost += (np.einsum("ix,ij,jx->", deviation, precision, deviation) + np.diag(precision) @ variance) / 2
    return float(-(posterior * np.log(np.maximum(posterior, 1e-300))).sum() - cost)


def _log_sides(shape: Prepared) -> np.ndarray:
    return np.asarray(np.log(np.maximum(shape.sides, THINNEST)))
