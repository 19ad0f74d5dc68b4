"""From what the stage is given to the problem that solvers solve: the shots' template, and a target in the same
scales."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.shape import NormalizedShape
from b23d.stages.geometry.keypoints import keypoint_candidates
from b23d.stages.solvers.objective import Problem
from b23d.stages.solvers.retrieval import retrieve
from b23d.stages.solvers.scaling import largest_distance, scale_distances, scale_features
from b23d.stages.solvers.shots import Shot, Template, combine_shots, smooth_among

if TYPE_CHECKING:
    from b23d.stages.solvers.options import Objective


def pose(
    normalize: NormalizedShape,
    reweight: PointFeatures,
    geodesic: GeodesicDistances,
    shot_normalize: Sequence[NormalizedShape],
    shot_reweight: Sequence[PointFeatures],
    shot_geodesic: Sequence[GeodesicDistances],
    shot_keypoints: Sequence[Keypoints],
    objective: Objective,
    retrieval: bool = False,
) -> tuple[Template, Problem]:
    """What the shots ask for (`template.shots`: the indices of those used), and the target it is asked of.

    Arguments are `optimize`'s, which see for errors. retrieval: use the one shot that looks most like the target.
    """
    used = list(range(len(shot_normalize)))
    if retrieval and len(used) > 1:
        used = [retrieve(reweight, shot_reweight)]
    shots = [
        _shot(i, shot_normalize[i], shot_reweight[i], shot_geodesic[i], shot_keypoints[i], objective) for i in used
    ]
    template = combine_shots(shots, objective.combine, objective.mask)
    return template, _problem(reweight, geodesic, len(normalize.points), template, objective)


def _problem(
    reweight: PointFeatures, geodesic: GeodesicDistances, n: int, template: Template, objective: Objective
) -> Problem:
    features, distances = _scaled("the target", reweight, geodesic, n, objective)
    if features.shape[1] != template.features.shape[1]:
        raise ValueError(
            f"features: expected {template.features.shape[1]} channels as the shots have, "
            f"got {features.shape[1]} on the target; "
            "use one encoder for all"
        )
    unreachable = np.isinf(distances)
    if unreachable.any():
        distances[unreachable] = largest_distance(distances)
    return Problem(features, distances, template.features, template.distances, template.mask, objective.alpha)


def _shot(
    index: int,
    shape: NormalizedShape,
    reweight: PointFeatures,
    geodesic: GeodesicDistances,
    keypoints: Keypoints,
    objective: Objective,
) -> Shot:
    name = f"shot {index}"
    features, distances = _scaled(name, reweight, geodesic, len(shape.points), objective)
    if not len(keypoints.ids):
        return Shot(str(index), keypoints.ids, features[:0], distances[:0, :0])
    at = keypoint_candidates(keypoints, shape, name)
    own, between = features[at], distances[np.ix_(at, at)]
    if objective.source_features == "keypoints":
        own = smooth_among(own, between, objective.source_sigma * (largest_distance(distances) or 1.0))
    return Shot(str(index), keypoints.ids, own, between)


def _scaled(
    name: str, reweight: PointFeatures, geodesic: GeodesicDistances, n: int, objective: Objective
) -> tuple[np.ndarray, np.ndarray]:
    """Features (n, channel) and distances (n, n) of one shape, float32, in the objective's scales."""
    features, distances = reweight.features, geodesic.distances
    if len(features) != n or len(distances) != n:
        raise ValueError(
            f"{name}: expected features and distances of its {n} candidates, "
            f"got {len(features)} and {len(distances)}; re-run reweight and geodesic"
        )
    if not np.isfinite(features).all():
        raise ValueError(
            f"{name}: expected finite features, got NaN or infinity ({reweight.descriptor}); check the descriptor"
        )
    return scale_features(features, objective.features, reweight.observed), scale_distances(
        distances, objective.distances
    )
