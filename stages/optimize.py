"""optimize: find the shots' keypoints among a target's candidates, by features and mutual distances."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.predictions import Prediction
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.shot_model import ShotModel
from b23d.stages.solvers.options import OptimizeParams

if TYPE_CHECKING:
    from b23d.stages.solvers.objective import Problem
    from b23d.stages.solvers.options import Adam, Discrete, Softmax


@stage(version=13, hints=Hints(memory_gb=0.5))
def optimize(
    normalize: NormalizedShape,
    reweight: PointFeatures,
    geodesic: GeodesicDistances,
    learn: ShotModel,
    params: OptimizeParams,
) -> Prediction:
    """The shots' keypoints on the target, one for every id that any shot used has.

    `objective` is L_feature + α L_distance of the chosen candidates for every method, so methods compare. `costs` are
    each keypoint's share of it and sum to it. `shots` are the indices of the shots used. A pair of the target's
    candidates that no path joins counts as the shape's largest distance; such a pair of a shot's keypoints counts as
    not observed.

    Raises ValueError: features of another encoder than the shots'; features or distances that do not fit the candidates
    or are not finite.
    """
    from b23d.stages.solvers.belonging import class_confidence
    from b23d.stages.solvers.calibration import LogisticMap
    from b23d.stages.solvers.likeness import occupancy
    from b23d.stages.solvers.objective import objective, shares
    from b23d.stages.solvers.posing import check_channels, pose
    from b23d.stages.solvers.posterior.finding import find
    from b23d.stages.solvers.posterior.geometry import in_box
    from b23d.stages.solvers.presence import presence
    from b23d.stages.solvers.retrieval import mean_feature, weights_of
    from b23d.stages.solvers.scaling import relative_distances, scale_features
    from b23d.stages.solvers.shots import check_fit
    from b23d.stages.solvers.template import template_of

    check_fit("the target", normalize, reweight, geodesic)
    check_channels(learn, reweight.features, "the target")
    weights = weights_of(learn, reweight, params.retrieval)
    template = template_of(learn, weights)
    features = scale_features(reweight.features, learn.feature_scale, reweight.observed)
    distances = relative_distances(geodesic.distances)
    problem = pose(features, distances, learn, template, params.alpha)
    present, confidence, front = presence(template, params.presence), None, None
    if params.method == "posterior":
        if learn.feature_scale != "centred-unit":
            features = scale_features(reweight.features, "centred-unit", reweight.observed)
        found = find(normalize.points, features, distances, learn, weights, params.posterior, mean_feature(reweight))
        choice, confidence = found.points, LogisticMap(*learn.sureness)(found.mass).astype(np.float32)
        present = found.present if params.presence == "evidence" else present
        front = found.front_margin
    else:
        choice = _solve(problem, params)
    chosen, each = problem.among(choice), np.arange(len(choice))
    costs = shares(chosen, each)
    return Prediction(
        ids=template.ids,
        points=choice.astype(np.int32),
        positions=normalize.points[choice],
        present=present,
        costs=costs.astype(np.float32),
        confidence=confidence,
        class_confidence=class_confidence(learn, mean_feature(reweight), occupancy(in_box(normalize.points)[0])),
        front_margin=front,
        objective=float(objective(chosen, each)),
        method=params.method,
        shots=template.shots,
    )


def _solve(problem: Problem, params: OptimizeParams) -> np.ndarray:
    """The choice of a method that solves the problem posed, (k,) int64."""
    from b23d.stages.solvers.discrete import discrete
    from b23d.stages.solvers.hungarian import hungarian
    from b23d.stages.solvers.nearest import nearest

    if params.method == "nearest":
        return nearest(problem)
    if params.method == "hungarian":
        return hungarian(problem, params.hungarian.assignment)

    if params.method == "softmax":
        return _relaxed(problem, params.softmax, params.softmax)
    own = params.discrete
    extra = [_relaxed(problem, own.softmax, own)] if own.softmax_start else []
    return discrete(
        problem, starts=own.starts, passes=own.passes, seed=own.seed, one_to_one=own.one_to_one, extra=extra
    )


def _relaxed(problem: Problem, adam: Adam, search: Softmax | Discrete) -> np.ndarray:
    from b23d.stages.solvers.softmax import softmax

    return softmax(
        problem,
        beta=adam.beta,
        steps=adam.steps,
        learning_rate=adam.learning_rate,
        seed=search.seed,
        one_to_one=search.one_to_one,
    )
