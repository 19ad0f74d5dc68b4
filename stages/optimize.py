"""optimize: find the shots' keypoints among a target's candidates, by features and mutual distances."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.predictions import Prediction
from b23d.schemas.shape import NormalizedShape
from b23d.stages.solvers.options import OptimizeParams

if TYPE_CHECKING:
    from b23d.stages.solvers.objective import Problem
    from b23d.stages.solvers.options import Adam, Discrete, Softmax
    from b23d.stages.solvers.posterior.predicting import Found


@stage(version=3, hints=Hints(memory_gb=0.5))
def optimize(
    normalize: NormalizedShape,
    reweight: PointFeatures,
    geodesic: GeodesicDistances,
    shot_normalize: list[NormalizedShape],
    shot_reweight: list[PointFeatures],
    shot_geodesic: list[GeodesicDistances],
    shot_keypoints: list[Keypoints],
    params: OptimizeParams,
) -> Prediction:
    """The shots' keypoints on the target, one for every id that any shot used has.

    `objective` is L_feature + α L_distance of the chosen candidates for every method, so methods compare: with the
    method's own constants, or with the defaults where it has none. `costs` are each keypoint's share of it and sum to
    it. `shots` are the indices of the shots used. A pair of the target's
    candidates that no path joins counts as the shape's largest distance; such a pair of a shot's keypoints counts as
    not observed.

    Raises ValueError: no keypoint in any shot; several shots of which no two share an id; features of different
    encoders; features or distances that do not fit the candidates or are not finite; a keypoint beyond the cloud.
    """
    from b23d.stages.solvers.objective import objective, shares
    from b23d.stages.solvers.posing import pose
    from b23d.stages.solvers.presence import presence

    template, problem = pose(
        normalize,
        reweight,
        geodesic,
        shot_normalize,
        shot_reweight,
        shot_geodesic,
        shot_keypoints,
        params.measure,
        params.retrieval,
    )
    used = [int(name) for name in template.shots]
    points = normalize.points
    found = _posterior(
        normalize, reweight, geodesic, used, shot_normalize, shot_reweight, shot_geodesic, shot_keypoints, params
    )
    choice = _solve(problem, params) if found is None else found.points
    costs = shares(problem, choice)
    rule = params.chosen.presence
    present = found.present if found is not None and rule == "evidence" else presence(costs, template, rule)
    return Prediction(
        ids=template.ids,
        points=choice.astype(np.int32),
        positions=points[choice],
        present=present,
        costs=costs.astype(np.float32),
        confidence=None if found is None else found.hits.astype(np.float32),
        objective=float(objective(problem, choice)),
        method=params.method,
        shots=template.shots,
    )


def _posterior(
    shape: NormalizedShape,
    reweight: PointFeatures,
    geodesic: GeodesicDistances,
    used: list[int],
    shot_normalize: list[NormalizedShape],
    shot_reweight: list[PointFeatures],
    shot_geodesic: list[GeodesicDistances],
    shot_keypoints: list[Keypoints],
    params: OptimizeParams,
) -> Found | None:
    """What the posterior method finds; None for other methods."""
    if params.method != "posterior":
        return None

    from b23d.stages.geometry.keypoints import keypoint_candidates
    from b23d.stages.solvers.posterior.geometry import Prepared, prepare
    from b23d.stages.solvers.posterior.learning import learn
    from b23d.stages.solvers.posterior.predicting import predict
    from b23d.stages.solvers.posterior.turning import aligned, in_frame
    from b23d.stages.solvers.scaling import largest_distance, scale_features

    def prepared(
        s: NormalizedShape, f: PointFeatures, g: GeodesicDistances, k: Keypoints | None = None, name: str = ""
    ) -> Prepared:
        features = scale_features(f.features, "centred-unit", f.observed)
        distances = g.distances.astype(np.float32)
        distances[np.isinf(distances)] = largest_distance(distances)
        at = None if k is None else keypoint_candidates(k, s, name)
        return prepare(s.points, features, distances, params.posterior.radii, None if k is None else k.ids, at)

    labelled = [i for i in used if len(shot_keypoints[i].ids)]
    shots = [
        prepared(shot_normalize[i], shot_reweight[i], shot_geodesic[i], shot_keypoints[i], f"shot {i}")
        for i in labelled
    ]
    shots, frames = aligned(shots, params.posterior)
    model = learn(shots, params.posterior)
    target = in_frame(model, frames, prepared(shape, reweight, geodesic), params.posterior)
    return predict(model, target, params.posterior)


def _solve(problem: Problem, params: OptimizeParams) -> np.ndarray:
    """The method's choice, (k,) int64."""
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
