"""What the shots teach: what keypoints look like, where they sit in the box, how they move together, and whether the
shots share a frame at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.stages.solvers.posterior.geometry import Prepared, squared
from b23d.stages.solvers.posterior.options import PosteriorParams


@dataclass(frozen=True)
class Model:
    """k ids, s shots, c components, g geometry channels, r radii."""

    ids: np.ndarray
    """(k,) sorted."""
    has: np.ndarray
    """(s, k) bool: which shot has which id."""
    basis: np.ndarray
    """(channel, c) principal directions."""
    mean: np.ndarray
    scale: np.ndarray
    """(c + g,) of the descriptor over all points of all shots."""
    keypoint: np.ndarray
    """(c + g,) discriminant "is a keypoint"."""
    identity: np.ndarray
    """(k, c + g) discriminants "is this keypoint rather than another"."""
    box: np.ndarray
    """(k, 3) mean place in the box."""
    shift: np.ndarray
    """(k, 3 r) mean shift vectors."""
    distances: np.ndarray
    """(k, k) mean relative geodesic distances, where `pairs`."""
    pairs: np.ndarray
    gate: float
    """How many times the shots' disagreement about places exceeds the prior's; at least 1."""

    def descriptor(self, shape: Prepared) -> np.ndarray:
        """(n, c + g), standardised."""
        return (_descriptor(shape, self.basis) - self.mean) / self.scale


def learn(shots: list[Prepared], params: PosteriorParams) -> Model:
    """Learn from labelled shapes; at least one keypoint among them."""
    ids = np.unique(np.concatenate([shot.ids for shot in shots]))
    rows = [np.searchsorted(ids, shot.ids) for shot in shots]
    features = np.concatenate([shot.features for shot in shots])
    features = features - features.mean(0)
    basis = np.linalg.eigh(features.T @ features)[1][:, ::-1][:, : params.components]
    every = np.concatenate([_descriptor(shot, basis) for shot in shots])
    mean, scale = every.mean(0), every.std(0) + 1e-6
    described = [(_descriptor(shot, basis) - mean) / scale for shot in shots]
    every = np.concatenate(described)
    covariance = every.T @ every / len(every) + params.ridge * np.eye(every.shape[1])
    centre = np.concatenate([d[shot.keypoints] for d, shot in zip(described, shots, strict=True)]).mean(0)

    def gather(values: list[np.ndarray]) -> np.ndarray:
        """(s, k, d) of the values (n, d) at each shot's keypoints; 0 where a shot lacks an id."""
        out = np.zeros((len(shots), len(ids), values[0].shape[1]))
        for s, (value, shot) in enumerate(zip(values, shots, strict=True)):
            out[s, rows[s]] = value[shot.keypoints]
        return out

    has = np.zeros((len(shots), len(ids)), bool)
    distances, counts = np.zeros((len(ids), len(ids))), np.zeros((len(ids), len(ids)))
    for s, shot in enumerate(shots):
        has[s, rows[s]] = True
        both = np.ix_(rows[s], rows[s])
        distances[both] += shot.distances[np.ix_(shot.keypoints, shot.keypoints)]
        counts[both] += 1
    shown = has.sum(0)[:, None]
    places = gather([shot.box for shot in shots])
    return Model(
        ids=ids,
        has=has,
        basis=basis,
        mean=mean,
        scale=scale,
        keypoint=np.linalg.solve(covariance, centre),
        identity=np.linalg.solve(covariance, (gather(described).sum(0) / shown - centre).T).T,
        box=places.sum(0) / shown,
        shift=gather([shot.shift for shot in shots]).sum(0) / shown,
        distances=distances / np.maximum(counts, 1),
        pairs=(counts > 0) & ~np.eye(len(ids), dtype=bool),
        gate=frame_gate(places, has, params),
    )


def deformation_covariance(box: np.ndarray, params: PosteriorParams) -> np.ndarray:
    """(k, k) covariance, for each axis, of keypoints' deviations from their mean places `box` (k, 3): affine,
    quadratic, smooth and independent parts (a Gaussian process with polynomial and squared-exponential kernels)."""
    corner = 2 * box  # ±1 at the box's corners
    product = corner @ corner.T
    affine = params.affine_sd**2 * (1 + product) / 2
    quadratic = params.quadratic_sd**2 * product**2 / 4
    smooth = params.smooth_sd**2 * np.exp(-squared(box, box) / (2 * params.smooth_length**2))
    return np.asarray(affine + quadratic + smooth + params.independent_sd**2 * np.eye(len(box)))


def frame_gate(places: np.ndarray, has: np.ndarray, params: PosteriorParams) -> float:
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
                np.linalg.solve(deformation_covariance(mean, params), deviation) / (1 + 1 / shown[known])[:, None]
            )
            total += float((deviation * explained).sum())
            count += deviation.size
    return max(1.0, total / count)


def _descriptor(shape: Prepared, basis: np.ndarray) -> np.ndarray:
    return np.concatenate([shape.features @ basis, shape.geometry], 1)
