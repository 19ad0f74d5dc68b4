"""From what the shots ask for and a target to the problem that solvers solve, in the same scales."""

from __future__ import annotations

import numpy as np

from b23d.schemas.shot_model import ShotModel
from b23d.stages.solvers.objective import Problem
from b23d.stages.solvers.scaling import Relative
from b23d.stages.solvers.template import Template


def pose(features: np.ndarray, distances: Relative, model: ShotModel, template: Template, alpha: float) -> Problem:
    """features (n, channel) of the target in the model's scale. A pair of candidates that no path joins counts as the
    shape's largest distance."""
    between = distances.relative
    if model.distance_scale == "unit-frame":
        between = between * np.float32(distances.largest)
    return Problem(features, between, template.features, template.distances, template.mask, alpha)


def check_channels(model: ShotModel, features: np.ndarray, name: str) -> None:
    """Raise ValueError where a shape's features (n, channel) are of another encoder than the shots'."""
    if features.shape[1] != len(model.basis):
        raise ValueError(
            f"features: expected {len(model.basis)} channels as the shots have ({model.descriptor}), "
            f"got {features.shape[1]} on {name}; use one encoder for all"
        )
