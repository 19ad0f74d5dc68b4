"""Whether a shape is of the shots' class at all: by what it looks like as a whole, and where it has surface."""

from __future__ import annotations

import numpy as np

from b23d.schemas.shot_model import ShotModel
from b23d.stages.solvers.likeness import overlaps

LEAST_LOOKS, LEAST_SURFACE = 1e-3, 0.05  # shots are taken to differ by so much at least
SAME = 1e-6
"""Shots that differ by less are copies, and count once."""
OFFSET, SLOPE = 2.27, 5.24
"""Of the logistic map from the logarithm of how far, fitted on CAPOD's 15 classes and the procedural ones (3 shots, 3
draws, the default encoder in 14 views), members and strangers alike heavy: about one member in twenty is flagged."""


def class_confidence(model: ShotModel, looks: np.ndarray, occupancy: np.ndarray) -> float | None:
    """Probability that a shape is of the shots' class; None with one shot, or copies of one, which cannot tell how
    much shapes of the class differ.

    looks: (channel,) its mean feature. occupancy: (cell,), as the shots'. How far it is from the nearest shot, each in
    units of the mean distance between shots: cosine distance of the looks, and of the blurred occupancies one less what
    they share of what they cover together (Ruzicka's similarity), which counts twice. Where the shots stand
    differently, looks alone.
    """
    looked, covered = (
        _cosines(np.vstack([looks, model.mean_features])),
        1 - overlaps(np.vstack([occupancy, model.occupancy])),
    )
    copies = np.triu((looked < SAME) & (covered < SAME), 1)[1:].any(axis=0)
    kept = np.flatnonzero(~copies)
    if len(kept) < 3:
        return None
    looked, covered = (distances[np.ix_(kept, kept)] for distances in (looked, covered))
    far = np.log(_relative(looked, LEAST_LOOKS))
    if not model.turns.any():
        far = (far + 2 * np.log(_relative(covered, LEAST_SURFACE))) / 3
    return float(1 / (1 + np.exp(SLOPE * far - OFFSET)))


def _relative(distances: np.ndarray, least: float) -> float:
    """Of distances (1 + s, 1 + s): the first's from the nearest other over the mean between the others."""
    shots = distances[1:, 1:]
    mean = shots[np.triu_indices(len(shots), 1)].mean()
    return float(max(distances[0, 1:].min(), 1e-4) / max(mean, least))


def _cosines(vectors: np.ndarray) -> np.ndarray:
    """(m, m) cosine distances of vectors (m, channel)."""
    wide = vectors.astype(np.float64)
    unit = wide / np.maximum(np.linalg.norm(wide, axis=1, keepdims=True), 1e-12)
    return np.asarray(1 - unit @ unit.T)
