"""A common frame for shapes that have none: shots are turned onto each other by their labels, targets by the evidence.
All turns are about the up axis, in radians, from +z towards +x."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.stages.solvers.likeness import occupancy, shared
from b23d.stages.solvers.posterior.a_few import a_few
from b23d.stages.solvers.posterior.contrast import contrast
from b23d.stages.solvers.posterior.geometry import THINNEST, Prepared, squared, turned
from b23d.stages.solvers.posterior.options import PosteriorParams
from b23d.stages.solvers.posterior.predicting import looks, mean_field, prior, shift_costs
from b23d.stages.solvers.posterior.weighing import Weighed

REFINED = 4  # local maxima of the first evidence that are followed up
REFERENCES = 8  # shots whose frame may be the common one
PLACE_SD = 0.05  # by which a keypoint's place differs from shape to shape, in longest box sides
EVIDENT = 3.0  # nats by which a turn must explain two shots' labels better than none does
AS_IT_IS = 60.0  # nats that it takes to turn a target where all shots stand alike; on aligned sets false fronts have 50
OPPOSITE = 20.0  # nats more that a half turn then takes than a small one: fronts of near-symmetric shapes are ties
ASKEW = 0.03  # overlap with the shots' surfaces that a turn must add to be looked for; 1 aligned target in 12 has it
CHANCE = 8.0  # standard deviation of what two fronts' evidence differs by without a reason; 10 nats may be a tie yet


@dataclass(frozen=True)
class InFrame:
    """A target in the shots' frame."""

    shape: Prepared
    margin: float | None
    """Nats of evidence by which this front beats the next best: near 0 it is a tie, and all but the choice is chance.
    What is presumed where the shots stand alike is not counted: below 0 it decided. None where none was looked for."""
    share: float
    """How probable it is that this is the front, 0 … 1."""
    others: tuple[tuple[float, np.ndarray], ...]
    """The probabilities of other fronts, and (k, n) where the keypoints are if it is that one."""


def aligned(shots: list[Prepared], same_frame: float) -> tuple[list[Prepared], np.ndarray]:
    """The shots, turned onto the one, of a few, that needs the least turning in all, and (s,) by which each was: 0 for
    those that stand as it does, within `same_frame` degrees."""
    references = [shots[i] for i in a_few(len(shots), REFERENCES)]
    pairs = np.array([[_turn(shot, reference, same_frame) for reference in references] for shot in shots])
    turns = pairs[:, np.abs(pairs).sum(0).argmin()]
    return [turned(shot, turn) for shot, turn in zip(shots, turns, strict=True)], turns


def in_frame(learned: Weighed, target: Prepared, params: PosteriorParams) -> InFrame:
    """The target, turned to where the shots' model explains it best. Where all shots stood alike, targets are taken to
    do so, too: a turn is only looked for where it makes the target's surface meet theirs better, and then much must
    speak for it.

    Every turn is judged by each keypoint alone, the best few by the mean field's lower bound (Bishop, Pattern
    Recognition, sec. 10.1) and by how the whole surface differs from itself turned half round, with where the surface
    lies, the box's proportions and a prior: as shots stood that stood alike, or any orientation.
    """
    alike = not learned.model.turns.any()
    angles = np.arange(params.turns) * (2 * np.pi / params.turns)
    candidates = [turned(target, angle) for angle in angles]
    surfaces = _overlaps(learned, candidates)
    if alike and surfaces.max() - surfaces[0] < ASKEW:
        return InFrame(target, None, 1.0, ())
    stands = _log_prior(angles, learned.model.turns[learned.model.has.any(1)], params)
    stands -= np.array([((_log_sides(shape) - learned.log_sides) ** 2).sum() for shape in candidates]) / (
        2 * params.sides_sd**2
    )
    presumed = np.zeros(len(angles))
    if alike:
        presumed -= OPPOSITE * (1 - np.cos(angles)) / 2
        presumed[0] = AS_IT_IS
    stands += presumed
    stands += params.surface_weight * surfaces
    said = looks(learned, target, params)
    unaries = [shift_costs(learned, shape, params) - said for shape in candidates]
    alone = [_evidence(learned, shape, unary) for shape, unary in zip(candidates, unaries, strict=True)]
    first = stands + np.array(alone) / params.temper
    peaks = np.flatnonzero((first >= np.roll(first, 1)) & (first >= np.roll(first, -1)))
    peaks = peaks[np.argsort(-first[peaks], kind="stable")][:REFINED]
    half = peaks[0] + params.turns // 2 + np.arange(-1, 2)
    if not np.isin(half % params.turns, peaks).any():
        peaks = np.append(peaks, half[1] % params.turns)
    fields = [mean_field(learned, candidates[i], unaries[i], params) for i in peaks]
    bounds = [_bound(learned, candidates[i], unaries[i], field, params) for i, field in zip(peaks, fields, strict=True)]
    evidence = stands[peaks] + np.array(bounds) / params.temper
    evidence += params.contrast_weight * np.array([_agreement(learned, candidates[i]) for i in peaks])
    best = int(evidence.argmax())
    shares = np.exp(-(((evidence - evidence[best]) / CHANCE) ** 2) / 2)
    shares /= shares.sum()
    others = [i for i in range(len(peaks)) if i != best]
    seen = evidence - presumed[peaks]
    margin = float(seen[best] - seen[others].max()) if others else None
    return InFrame(
        candidates[peaks[best]], margin, float(shares[best]), tuple((float(shares[i]), fields[i]) for i in others)
    )


def _turn(shot: Prepared, reference: Prepared, same_frame: float) -> float:
    """The turn that brings a shot's keypoints onto the reference's of the same ids (Procrustes about one axis); 0 where
    it is small, does not explain most of what parts them, or what it explains may be chance: few keypoints that lie
    near each other seem turned easily."""
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
    gain = (before - after) / (4 * PLACE_SD**2)  # of two places' difference
    evident = abs(angle) > np.deg2rad(same_frame) and after < before / 2 and gain > EVIDENT
    return angle if evident else 0.0


def _log_prior(angles: np.ndarray, turns: np.ndarray, params: PosteriorParams) -> np.ndarray:
    """(t,) log density, but for a constant: a mixture of a uniform distribution and, each as heavy, a von Mises one for
    every shot as far as another stood as it did: what has been seen once need not be seen again (Good and Turing)."""

    def agreement(some: np.ndarray) -> np.ndarray:
        """(…, s) 0 … 1; a target that stood as a shot needs that shot's turn."""
        return np.asarray(np.exp(params.turn_concentration * (np.cos(some[:, None] - turns) - 1)))

    among = agreement(turns)
    np.fill_diagonal(among, 0)
    peaks = agreement(angles) * np.sqrt(2 * np.pi * params.turn_concentration)
    return np.asarray(np.log(1 + peaks @ among.max(1, initial=0)))


def _overlaps(learned: Weighed, shapes: list[Prepared]) -> np.ndarray:
    """(t,) 0 … 1, of each shape's surface with the shots', on average."""
    of = np.flatnonzero(learned.shots)
    found = shared(np.stack([occupancy(shape.position) for shape in shapes]), learned.model.occupancy[of])
    return np.asarray(np.average(found, axis=1, weights=learned.shots[of]))


def _agreement(learned: Weighed, shape: Prepared) -> float:
    """−1 … 1, of its contrast with the shots', on average over them and over features and geometry."""
    model = learned.model
    own = contrast(shape, model.basis, model.mean, model.scale, model.along)
    return float(np.average(model.contrasts @ own, weights=learned.shots)) / 2


def _evidence(learned: Weighed, target: Prepared, unary: np.ndarray) -> float:
    """Log evidence with keypoints independent of each other."""
    place, covariance = prior(learned, target)
    costs = unary + squared(place, target.position.astype(np.float64)) / (2 * np.diag(covariance)[:, None])
    least = costs.min(1)
    return float((np.log(np.exp(least[:, None] - costs).sum(1)) - least).sum())


def _bound(
    learned: Weighed, target: Prepared, unary: np.ndarray, posterior: np.ndarray, params: PosteriorParams
) -> float:
    """Lower bound of the log evidence at the mean field, the posterior (k, n): its entropy less its expected cost."""
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
