"""The door of the posterior method: keypoints on a target, by what the shots teach."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from b23d.schemas.shot_model import ShotModel
from b23d.stages.solvers.likeness import occupancy
from b23d.stages.solvers.nearness import nearness
from b23d.stages.solvers.posterior.geometry import prepare
from b23d.stages.solvers.posterior.options import PosteriorParams
from b23d.stages.solvers.posterior.predicting import Found, near_mass, predict
from b23d.stages.solvers.posterior.registering import laid_over
from b23d.stages.solvers.posterior.turning import in_frame
from b23d.stages.solvers.posterior.weighing import weighed
from b23d.stages.solvers.scaling import Relative


def find(
    points: np.ndarray,
    features: np.ndarray,
    distances: Relative,
    model: ShotModel,
    weights: np.ndarray,
    params: PosteriorParams,
    looks: np.ndarray,
) -> Found:
    """The keypoints of every id that a shot of any weight has, by ascending id.

    points (n, 3) of the target, features (n, channel) centred and of unit length, weights (s,), looks (channel,) its
    mean feature. What keypoints look like is learned from all shots that count; where they are, from those most like
    it, laid over it as a whole and then around each.
    """
    stood = in_frame(weighed(model, weights), prepare(points, features, distances, model.radii), params)
    near = nearness(model, weights, occupancy(stood.shape.position), looks)
    found = predict(laid_over(weighed(model, weights, near), near, stood.shape), near, stood.shape, params)
    others = sum(share * near_mass(posterior, stood.shape, found.points) for share, posterior in stood.others)
    return replace(found, mass=stood.share * found.mass + others, front_margin=stood.margin)
