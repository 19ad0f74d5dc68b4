"""From shots and a target to the problem that solvers solve: the shots' template, and the target in the same scales."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from b23d.stages.solvers.objective import Problem
from b23d.stages.solvers.remembering import once
from b23d.stages.solvers.scaling import largest_distance, scale_distances, scale_features
from b23d.stages.solvers.shots import KnownShape, Shot
from b23d.stages.solvers.template import AtKeypoints, Template, combine_shots, smooth_among

if TYPE_CHECKING:
    from b23d.stages.solvers.options import Objective


def pose(target: KnownShape, shots: Sequence[Shot], objective: Objective) -> tuple[Template, Problem]:
    """What the shots ask for, and the target it is asked of.

    Raises ValueError: several shots of which no two share an id; features of another encoder than the shots'.
    """
    template = once(template_of, shots, objective)
    features, distances = _scaled(target, objective)
    if features.shape[1] != template.features.shape[1]:
        raise ValueError(
            f"features: expected {template.features.shape[1]} channels as the shots have, "
            f"got {features.shape[1]} on {target.name}; "
            "use one encoder for all"
        )
    unreachable = np.isinf(distances)
    if unreachable.any():
        distances[unreachable] = largest_distance(distances)
    return template, Problem(features, distances, template.features, template.distances, template.mask, objective.alpha)


def template_of(shots: Sequence[Shot], objective: Objective) -> Template:
    """What the shots ask for, the same for every target, so asked for by `once`."""
    return combine_shots([_at_keypoints(shot, objective) for shot in shots], objective.combine, objective.mask)


def _at_keypoints(shot: Shot, objective: Objective) -> AtKeypoints:
    features, distances = _scaled(shot, objective)
    own, between = features[shot.at], distances[np.ix_(shot.at, shot.at)]
    if objective.source_features == "keypoints" and len(shot.at):
        own = smooth_among(own, between, objective.source_sigma * (largest_distance(distances) or 1.0))
    return AtKeypoints(str(shot.index), shot.keypoints.ids, own, between)


def _scaled(one: KnownShape, objective: Objective) -> tuple[np.ndarray, np.ndarray]:
    """Features (n, channel) and distances (n, n) of one shape, float32, in the objective's scales."""
    features = scale_features(one.features.features, objective.features, one.features.observed)
    return features, scale_distances(one.distances.distances, objective.distances)
