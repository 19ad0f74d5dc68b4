"""What the shots teach: what keypoints look like, where they sit in the box, how they move together, and whether the
shots share a frame at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from b23d.stages.solvers.learn_options import Deformation, LearnParams
from b23d.stages.solvers.posterior.a_few import a_few
from b23d.stages.solvers.posterior.geometry import Prepared, descriptors, squared
from b23d.stages.solvers.posterior.weighing import FAR

WORTH = 100.0  # examples, beyond each id's first, that make keypoints' own covariance count as much as all points'
SEEN = 20_480  # points that tell what the surfaces look like; of more, every so many of each shot
COPIES = 1e-6  # examples that differ by less than this share of what points do are copies, and tell nothing


@dataclass(frozen=True)
class DescriptorBasis:
    """c components of features, g geometry channels."""

    basis: np.ndarray
    """(channel, c) float32, principal directions."""
    mean: np.ndarray
    scale: np.ndarray
    """(c + g,) float32, of the descriptor over the points of all shots."""
    covariance: np.ndarray
    """(c + g, c + g) of the standardised descriptor over the same points."""


def basis_of(shots: Sequence[Prepared], params: LearnParams) -> DescriptorBasis:
    """Of the points of the shots, whatever their labels."""
    each = [_spread(shot, SEEN / sum(len(shot.position) for shot in shots)) for shot in shots]
    features = np.concatenate([shot.features[points] for shot, points in zip(shots, each, strict=True)])
    features = features - features.mean(0)
    basis = np.linalg.eigh(features.T @ features)[1][:, ::-1][:, : params.components]
    basis = basis * np.sign(basis[np.abs(basis).argmax(0), np.arange(basis.shape[1])])  # the same on every machine
    every = np.concatenate([descriptors(shot, basis, points) for shot, points in zip(shots, each, strict=True)])
    mean, scale = every.mean(0), every.std(0) + np.float32(1e-6)
    every = (every - mean) / scale
    return DescriptorBasis(np.ascontiguousarray(basis), mean, scale, every.T @ every / len(every))


def _spread(shot: Prepared, share: float) -> np.ndarray:
    """Such a share of the points, all over the surface, however they are ordered; all of them for 1 and more."""
    count = len(shot.position)
    return np.lexsort(shot.position.T)[a_few(count, max(1, int(share * count)))] if share < 1 else np.arange(count)


def discriminating_covariance(everywhere: np.ndarray, examples: np.ndarray, has: np.ndarray) -> np.ndarray:
    """(d, d) float64, against which discriminants are taken: the covariance of all points (d, d), moved towards that of
    each id's examples (s, k, d) about their mean, where `has` (s, k), as far as there are some (Fisher's linear
    discriminant; Friedman, 1989): what differs from shot to shot at one keypoint tells little. Its trace stays."""
    several = has & (has.sum(0) > 1)
    free = int(several.sum() - several.any(0).sum())
    mean = np.einsum("sk,skd->kd", has.astype(np.float64), examples) / np.maximum(has.sum(0), 1)[:, None]
    apart = (examples - mean)[several]
    squares, wanted = float((apart**2).sum()), float(np.trace(everywhere))
    if squares <= COPIES * free * wanted:
        return np.asarray(everywhere, np.float64)
    share = free / (free + WORTH)
    return np.asarray((1 - share) * everywhere + share * wanted / squares * (apart.T @ apart))


def deformation_covariance(places: np.ndarray, params: Deformation) -> np.ndarray:
    """(k, k) covariance, for each axis, of keypoints' deviations from their mean places (k, 3) in the box: affine,
    quadratic, smooth and independent parts (a Gaussian process with polynomial and squared-exponential kernels)."""
    corner = 2 * places  # ±1 at the box's corners
    product = corner @ corner.T
    affine = params.affine_sd**2 * (1 + product) / 2
    quadratic = params.quadratic_sd**2 * product**2 / 4
    smooth = params.smooth_sd**2 * np.exp(-squared(places, places) / (2 * params.smooth_length**2))
    return np.asarray(affine + quadratic + smooth + params.independent_sd**2 * np.eye(len(places)))


def learned_covariance(deviations: np.ndarray, prior: np.ndarray, worth: float) -> np.ndarray:
    """(k, k) mean of an inverse Wishart distribution about `prior` (k, k), which counts as `worth` deviations, given
    those of shots (s, k, 3), NaN where they say nothing: there, what the prior makes of the others."""
    total, count = worth * prior, worth
    for deviation in deviations:
        known = np.isfinite(deviation[:, 0])
        if known.any():
            told = np.linalg.solve(prior[np.ix_(known, known)], prior[known]).T
            filled = told @ deviation[known]
            total = total + filled @ filled.T + filled.shape[1] * (prior - told @ prior[known])
            count += filled.shape[1]
    return np.asarray((total + total.T) / (2 * count))


def deviations_of(has: np.ndarray, values: np.ndarray, near: np.ndarray) -> np.ndarray:
    """(s, k, d) of each shot's values (s, k, d) from the others' mean, weighted by how near they are to it, (s, s); NaN
    where it lacks the id, or all others do."""
    others = np.where(np.eye(len(has), dtype=bool), 0, near + FAR)
    counts = np.einsum("ts,sk->tk", others, has)[..., None]
    sums = np.einsum("ts,skd->tkd", others, values * has[..., None])
    mean = np.divide(sums, counts, out=np.full(values.shape, np.nan), where=counts > 0)
    return np.asarray(np.where(has[..., None], values - mean, np.nan))


def frame_gate(places: np.ndarray, has: np.ndarray, params: LearnParams) -> float:
    """Leave-one-out among the shots: normalised squared deviation of each shot's keypoints (s, k, 3) from the others'
    mean, at least 1. About 1 where shapes are aligned, 5 and more where each is turned its own way; 1 with one shot,
    which cannot tell."""
    total, count = params.gate_prior, params.gate_prior
    for s in range(len(has)):
        others = np.delete(has, s, 0)
        shown = others.sum(0)
        known = has[s] & (shown > 0)
        if known.any():
            mean = np.where(others[:, known, None], np.delete(places, s, 0)[:, known], 0).sum(0) / shown[known][:, None]
            deviation = places[s][known] - mean
            explained = (
                np.linalg.solve(deformation_covariance(mean, params.deformation), deviation)
                / (1 + 1 / shown[known])[:, None]
            )
            total += float((deviation * explained).sum())
            count += deviation.size
    return max(1.0, total / count)
