"""Which shots a target's keypoints are expected from: those most like it. One mean of shapes that differ gets no better
with more shots."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from b23d.schemas.shot_model import ShotModel
from b23d.stages.solvers.likeness import cosine, overlap, overlaps, standardised

SHARPEST = 50.0


def nearness(model: ShotModel, weights: np.ndarray, cells: np.ndarray, looks: np.ndarray) -> npt.NDArray[np.float64]:
    """(s,) weights of the shots for where keypoints are on a shape of occupancy `cells` (cell,) in the common frame and
    mean feature `looks` (channel,): the largest 1, 0 for shots of no weight (s,) and for those without keypoints."""
    use = (weights > 0) & model.has.any(1)
    near = np.zeros(len(use))
    near[use] = softened(overlap(cells, model.occupancy[use]), cosine(looks, model.mean_features[use]))
    return near


def among(known: np.ndarray, occupancies: np.ndarray, looks: np.ndarray) -> npt.NDArray[np.float64]:
    """(s, s) `nearness` of the other shots, of those `known` (s,) to have keypoints, to each of them; 0 in its rows
    where there is none."""
    near, shared = np.zeros((len(known), len(known))), overlaps(occupancies)
    for i in np.flatnonzero(known):
        others = known & (np.arange(len(known)) != i)
        if others.any():
            near[i, others] = softened(shared[i, others], cosine(looks[i], looks[others]))
    return near


def softened(shared: np.ndarray, alike: np.ndarray) -> npt.NDArray[np.float64]:
    """(s,) weights, the largest 1, from how much of the surface is shared and how alike the looks are, which count the
    same: exponentials of a sharpness that leaves √s + ½ shots' worth of them (Kish's effective sample size). One shot
    or two count almost as they are, of 25 the most alike five or six."""
    scores = standardised(shared) + standardised(alike)
    below, wanted = scores - scores.max(), len(scores) ** 0.5 + 0.5
    low, high = 0.0, SHARPEST
    if wanted >= len(scores):
        return np.ones(len(scores))
    for _ in range(40):
        middle = (low + high) / 2
        low, high = (middle, high) if effective(np.exp(middle * below)) > wanted else (low, middle)
    return np.asarray(np.exp(low * below))


def effective(weights: np.ndarray) -> float:
    """How many equal weights are as many as these (s,)."""
    return float(weights.sum() ** 2 / (weights**2).sum())
