"""What the shots say of each other: each found by the others, as if it were a target."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from b23d.schemas.shot_model import ShotModel
from b23d.stages.solvers.nearness import nearness
from b23d.stages.solvers.posterior.a_few import a_few
from b23d.stages.solvers.posterior.geometry import Prepared
from b23d.stages.solvers.posterior.options import PosteriorParams
from b23d.stages.solvers.posterior.predicting import NEAR, predict
from b23d.stages.solvers.posterior.registering import laid_over
from b23d.stages.solvers.posterior.weighing import weighed

FOLDS = 8
"""Most shots that are held out: what they cost does not grow with the shots."""


def folds(has: np.ndarray) -> np.ndarray:
    """The shots to hold out, of `has` (s, k): spread evenly over those whose others have keypoints, too."""
    known = np.flatnonzero(has.any(1))
    if len(known) < 2:
        return np.zeros(0, int)
    return known[a_few(len(known), FOLDS)]


def held_out(model: ShotModel, shots: Sequence[Prepared], which: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(s, k) float32 and bool: how sure the others are of each id on each shot of `which`, and whether they are right:
    the shot has the id, and it is found within `NEAR`. NaN where nobody said. Basis and deviations are those of all.

    shots: (s,) in the common frame; distances are needed of those of `which` alone.
    """
    sure, near = np.full(model.has.shape, np.nan, np.float32), np.zeros(model.has.shape, bool)
    for i in which:
        weights = np.ones(len(shots))
        weights[i] = 0
        alike = nearness(model, weights, model.occupancy[i], model.mean_features[i])
        shot = shots[i]
        found = predict(laid_over(weighed(model, weights, alike), alike, shot), alike, shot, PosteriorParams())
        columns = np.flatnonzero((weights @ model.has) > 0)
        sure[i, columns] = found.mass
        row = {int(id): int(at) for id, at in zip(shot.ids, shot.keypoints, strict=True)}
        for column, point in zip(columns, found.points, strict=True):
            at = row.get(int(model.ids[column]))
            near[i, column] = at is not None and shot.distances[point, at] * shot.diameter <= NEAR
    return sure, near
