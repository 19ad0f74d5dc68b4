"""The door of the posterior method: keypoints on a target, by what the shots teach."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from b23d.stages.solvers.posterior.geometry import Prepared, prepare
from b23d.stages.solvers.posterior.learning import Model, learn
from b23d.stages.solvers.posterior.options import PosteriorParams
from b23d.stages.solvers.posterior.predicting import Found, predict
from b23d.stages.solvers.posterior.turning import Frames, aligned, in_frame
from b23d.stages.solvers.remembering import once
from b23d.stages.solvers.scaling import largest_distance, scale_features
from b23d.stages.solvers.shots import KnownShape, Shot


def find(target: KnownShape, shots: Sequence[Shot], params: PosteriorParams) -> Found:
    """The keypoints of every id that any shot has, by ascending id. At least one shot has a keypoint, and all have as
    many feature channels as the target."""
    model, frames = once(learned, shots, params)
    return predict(model, in_frame(model, frames, _prepared(target, params), params), params)


def learned(shots: Sequence[Shot], params: PosteriorParams) -> tuple[Model, Frames]:
    """What the shots that have keypoints teach, turned onto each other where they stand differently; the same for every
    target, so asked for by `once`."""
    prepared = [_prepared(shot, params) for shot in shots if len(shot.at)]
    turned, frames = aligned(prepared, params)
    return learn(turned, params), frames


def _prepared(one: KnownShape, params: PosteriorParams) -> Prepared:
    features = scale_features(one.features.features, "centred-unit", one.features.observed)
    distances = one.distances.distances.astype(np.float32)
    distances[np.isinf(distances)] = largest_distance(distances)
    if isinstance(one, Shot):
        return prepare(one.shape.points, features, distances, params.radii, one.keypoints.ids, one.at)
    return prepare(one.shape.points, features, distances, params.radii)
