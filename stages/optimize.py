"""optimize: find the shots' keypoints among a target's candidates, by features and mutual distances."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from pipeline.stage import Hints, stage
from schemas.features import GeodesicDistances, PointFeatures
from schemas.keypoints import Prediction
from schemas.params import Params
from schemas.shape import Keypoints, NormalizedShape
from stages.posterior.options import PosteriorParams

if TYPE_CHECKING:
    from stages.posterior.predicting import Found
    from stages.solvers.objective import Problem


class OptimizeParams(Params):
    """How keypoints are chosen. The objective is L = ‖F[c] − F_kp‖ + α ‖(D[c, c] − D_kp) ∘ M‖ − β R for all methods that have one."""

    method: Literal["posterior", "discrete", "softmax", "nearest", "hungarian"] = "posterior"
    """"posterior": the points of most expected hits under a model learned from the shots (`stages/posterior/`); where the shots stand
    differently about the up axis, they are turned onto each other and every target onto them. The others choose by the paper's
    objective or a part of it.
    "discrete": coordinate descent on the choice, from many starts. "softmax": the paper's relaxation, driven by Adam.
    "nearest": each keypoint's nearest feature. "hungarian": the linear assignment by feature distance. The last two use no α."""
    alpha: float = Field(default=0.25, ge=0)
    """Weight of the distance term. It depends on the scale of `features`: .25 suits those of length 1; the paper has 4 with raw DINOv2."""
    beta: float = Field(default=0.0, ge=0)
    """Weight of the paper's selection reward R; "softmax" only, since R is constant on choices. The paper finds 0 best."""
    features: Literal["raw", "centred", "centred-unit", "standardised"] = "centred-unit"
    """Scale of the features, each shape by itself. "raw": as extracted (the paper). "centred": less the shape's mean. "centred-unit":
    then each point's feature to length 1. "standardised": every channel to mean 0 and variance 1 / channels."""
    combine: Literal["mean", "sum_distances"] = "mean"
    """Several shots: "mean" averages features per id and distances per pair over the shots that have them (the paper);
    "sum_distances" averages features but sums distances (the published code)."""
    source_features: Literal["cloud", "keypoints"] = "cloud"
    """Features of the shots' keypoints: "cloud" takes them from the whole shot's smoothed features; "keypoints" smooths them among the
    shot's keypoints only, as the published code does. Whole-shape smoothing is `reweight`'s: set its σ to 0 to have this one alone."""
    source_sigma: float = Field(default=0.01, gt=0)
    """σ of `source_features = "keypoints"`, in units of the shot's largest distance."""
    distances: Literal["largest", "unit-frame"] = "largest"
    """Unit of the distance term: "largest" divides by each shape's own largest distance (the paper); "unit-frame" does not."""
    mask: Literal["pairs", "positive", "whole"] = "pairs"
    """M. "pairs": pairs of different ids that some shot has both of. "positive": entries of D_kp above 0 (the published code), so
    without pairs that coincide. "whole": as "pairs", and the diagonal (the paper's formula; only "softmax" can tell)."""
    seed: int = Field(default=0, ge=0)
    """Of "softmax"'s initial S and of "discrete"'s random starts."""
    steps: int = Field(default=5000, ge=0)
    """Adam steps of "softmax"."""
    learning_rate: float = Field(default=0.1, gt=0)
    """Of "softmax"'s Adam."""
    starts: int = Field(default=32, ge=1)
    """Starts of "discrete": nearest neighbour, assignment, and random ones."""
    sweeps: int = Field(default=100, ge=1)
    """Most sweeps over the keypoints of a start of "discrete"; one ends as soon as no move lowers its objective, after three to eight."""
    softmax_start: bool = False
    """Let "discrete" start from the softmax's result, too, which it is then never worse than. As slow as "softmax"."""
    one_to_one: bool = False
    """No candidate for two keypoints ("discrete" and "softmax"; "hungarian" never gives one twice)."""
    assignment: Literal["labelled", "sorted"] = "labelled"
    """"hungarian" only: "labelled" gives each id the candidate assigned to it; "sorted" gives the ids the same candidates in the order
    of their indices, as the published code does, whose labels are lost by that."""
    retrieval: bool = False
    """Use only the shot whose class token is nearest to the target's by cosine (mean feature, where an encoder has no class token)."""
    presence: Literal["all", "majority", "evidence"] = "evidence"
    """Which ids to predict: "all" that any shot has (the paper); "majority": those of more than half of the shots; "evidence": groups of
    ids that "posterior" expects to hit (`posterior.present`); methods without expectations then predict all."""
    posterior: PosteriorParams = PosteriorParams()
    """Constants of "posterior"."""

    @model_validator(mode="after")
    def _nearest_repeats(self) -> Self:
        if self.method == "nearest" and self.one_to_one:
            raise ValueError('one_to_one: expected a method that can keep candidates apart, got "nearest"; use "hungarian"')
        return self


@stage(version=2, hints=Hints(memory_gb=0.5))
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

    `objective` is L_feature + α L_distance of the chosen candidates for every method, so methods compare; `costs` are each
    keypoint's share of it and sum to it. `shots` are the indices of the shots used. A pair of the target's candidates that
    no path joins counts as the shape's largest distance; such a pair of a shot's keypoints counts as not observed.

    Raises ValueError: no keypoint in any shot; several shots of which no two share an id; features of different encoders;
    features or distances that do not fit the candidates or are not finite; a keypoint beyond the cloud.
    """
    from stages.solvers.objective import objective, shares
    from stages.solvers.posing import pose
    from stages.solvers.presence import presence

    template, problem = pose(normalize, reweight, geodesic, shot_normalize, shot_reweight, shot_geodesic, shot_keypoints, params)
    used = [int(name) for name in template.shots]
    points = normalize.points
    found = _posterior(normalize, reweight, geodesic, used, shot_normalize, shot_reweight, shot_geodesic, shot_keypoints, params)
    choice = _solve(problem, params) if found is None else found.points
    costs = shares(problem, choice)
    by_rule = presence(costs, template, params.presence)
    present = found.present if found is not None and params.presence == "evidence" else by_rule
    return Prediction(
        ids=template.ids,
        points=choice.astype(np.int32),
        positions=points[choice],
        present=present,
        costs=costs.astype(np.float32),
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

    from stages.geometry.keypoints import keypoint_candidates
    from stages.posterior.geometry import Prepared, prepare
    from stages.posterior.learning import learn
    from stages.posterior.predicting import predict
    from stages.posterior.turning import aligned, in_frame
    from stages.solvers.scaling import largest_distance, scale_features

    def prepared(s: NormalizedShape, f: PointFeatures, g: GeodesicDistances, k: Keypoints | None = None, name: str = "") -> Prepared:
        features = scale_features(f.features, "centred-unit", f.observed)
        distances = g.distances.astype(np.float32)
        distances[np.isinf(distances)] = largest_distance(distances)
        at = None if k is None else keypoint_candidates(k, s, name)
        return prepare(s.points, features, distances, params.posterior.radii, None if k is None else k.ids, at)

    labelled = [i for i in used if len(shot_keypoints[i].ids)]
    shots = [prepared(shot_normalize[i], shot_reweight[i], shot_geodesic[i], shot_keypoints[i], f"shot {i}") for i in labelled]
    shots, frames = aligned(shots, params.posterior)
    model = learn(shots, params.posterior)
    target = in_frame(model, frames, prepared(shape, reweight, geodesic), params.posterior)
    return predict(model, target, params.posterior)


def _solve(problem: Problem, params: OptimizeParams) -> np.ndarray:
    """The method's choice, (k,) int64."""
    from stages.solvers.discrete import discrete
    from stages.solvers.hungarian import hungarian
    from stages.solvers.nearest import nearest

    if params.method == "nearest":
        return nearest(problem)
    if params.method == "hungarian":
        return hungarian(problem, params.assignment)
    search: dict[str, Any] = {"starts": params.starts, "sweeps": params.sweeps, "seed": params.seed, "one_to_one": params.one_to_one}
    if params.method == "discrete" and not params.softmax_start:
        return discrete(problem, **search)

    from stages.solvers.softmax import softmax

    relaxed = softmax(
        problem,
        beta=params.beta,
        steps=params.steps,
        learning_rate=params.learning_rate,
        seed=params.seed,
        one_to_one=params.one_to_one,
    )
    if params.method == "softmax":
        return relaxed
    return discrete(problem, **search, extra=[relaxed])
