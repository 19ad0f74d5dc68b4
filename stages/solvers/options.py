"""What `optimize` can be told: the method, and each method's own table."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from b23d.schemas.params import Params, When
from b23d.stages.solvers.hungarian import Assignment
from b23d.stages.solvers.posterior.options import PosteriorParams
from b23d.stages.solvers.scaling import DistanceScale, FeatureScale


class Matching(Params):
    """By which features a keypoint of the shots is looked for on the target."""

    features: FeatureScale = "centred-unit"
    """Scale of the features, each shape by itself. "raw": as extracted (the paper). "centred": less the shape's mean.
    "centred-unit": then each point's feature to length 1. "standardised": every channel to mean 0 and variance 1 /
    channels."""
    source_features: Literal["cloud", "keypoints"] = "cloud"
    """Features of the shots' keypoints (DIFFERENCES.md, row 7): "cloud" takes them from the whole shot's smoothed
    features; "keypoints" smooths them among the shot's keypoints only, as the published code does. Whole-shape
    smoothing is `reweight`'s: set its σ to 0 to have this one alone."""
    source_sigma: Annotated[float, When(source_features="keypoints")] = Field(default=0.01, gt=0)
    """σ of that smoothing, in units of the shot's largest distance."""
    presence: Literal["all", "majority"] = "all"
    """Which ids to predict (DIFFERENCES.md, row 22): "all" that any shot has (the paper); "majority": those of more
    than half of the shots."""


class Objective(Matching):
    """L = ‖F[c] − F_kp‖ + α ‖(D[c, c] − D_kp) ∘ M‖."""

    alpha: float = Field(default=0.25, ge=0)
    """Weight of the distance term. It depends on the scale of `features`: .25 suits those of length 1; the paper has 4
    with raw DINOv2."""
    combine: Literal["mean", "sum_distances"] = "mean"
    """Several shots (DIFFERENCES.md, row 1): "mean" averages features per id and distances per pair over the shots that
    have them (the paper); "sum_distances" averages features but sums distances (the published code)."""
    distances: DistanceScale = "largest"
    """Unit of the distance term (DIFFERENCES.md, row 9): "largest" divides by each shape's own largest distance (the
    paper); "unit-frame" does not."""
    mask: Literal["pairs", "positive"] = "pairs"
    """M (DIFFERENCES.md, row 10). "pairs": pairs of different ids that some shot has both of. "positive": entries of
    D_kp above 0 (the published code), so without pairs that coincide."""


class Adam(Params):
    """The paper's optimiser of its relaxation."""

    beta: float = Field(default=0.0, ge=0)
    """Weight of the paper's selection reward R, which is constant on choices. The paper finds 0 best."""
    steps: int = Field(default=5000, ge=1)
    """DIFFERENCES.md, row 11."""
    learning_rate: float = Field(default=0.1, gt=0)
    """DIFFERENCES.md, row 11."""


class Softmax(Adam, Objective):
    """The paper's relaxation, with − β R in its objective."""

    mask: Literal["pairs", "positive", "whole"] = "pairs"  # type: ignore[assignment]  # one more than others can tell
    """M (DIFFERENCES.md, row 10). "pairs": pairs of different ids that some shot has both of. "positive": entries of
    D_kp above 0 (the published code), so without pairs that coincide. "whole": as "pairs", and the diagonal (the
    paper's formula)."""
    one_to_one: bool = False
    """No candidate for two keypoints."""
    seed: int = Field(default=0, ge=0)
    """Of the initial S."""


class Discrete(Objective):
    """Coordinate descent on the choice itself."""

    starts: int = Field(default=32, ge=2)
    """Nearest neighbour, assignment, and random ones."""
    passes: int = Field(default=100, ge=1)
    """Most passes over the keypoints of a start; one ends as soon as no move lowers its objective, after three to
    eight."""
    one_to_one: bool = False
    """No candidate for two keypoints."""
    seed: int = Field(default=0, ge=0)
    """Of the random starts."""
    softmax_start: bool = False
    """Start from the softmax's result, too, which the result is then never worse than. As slow as "softmax"."""
    softmax: Annotated[Adam, When(softmax_start=True)] = Adam()


class Hungarian(Matching):
    assignment: Assignment = "labelled"
    """DIFFERENCES.md, row 17. "labelled" gives each id the candidate assigned to it; "sorted" gives the ids the same
    candidates in the order of their indices, as the published code does, whose labels are lost by that."""


class OptimizeParams(Params):
    """How keypoints are chosen (DIFFERENCES.md, row 11)."""

    method: Literal["posterior", "discrete", "softmax", "nearest", "hungarian"] = "posterior"
    """"posterior": the points of most expected hits under a model learned from the shots (`stages/solvers/posterior/`);
    where the shots stand differently about the up axis, they are turned onto each other and every target onto them. The
    others choose by the paper's objective or a part of it.
    "discrete": coordinate descent on the choice, from many starts. "softmax": the paper's relaxation, driven by Adam.
    "nearest": each keypoint's nearest feature. "hungarian": the linear assignment by feature distance."""
    retrieval: bool = False
    """Use only the shot whose class token is nearest to the target's by cosine (mean feature, where an encoder has no
    class token)."""
    posterior: Annotated[PosteriorParams, When(method="posterior")] = PosteriorParams()
    discrete: Annotated[Discrete, When(method="discrete")] = Discrete()
    softmax: Annotated[Softmax, When(method="softmax")] = Softmax()
    nearest: Annotated[Matching, When(method="nearest")] = Matching()
    hungarian: Annotated[Hungarian, When(method="hungarian")] = Hungarian()

    @property
    def chosen(self) -> PosteriorParams | Matching:
        """The method's own table."""
        table: PosteriorParams | Matching = getattr(self, self.method)
        return table

    @property
    def measure(self) -> Objective:
        """What the choice is judged by, whatever found it: the method's own objective, or the default one on the
        features that the method compares."""
        table = self.chosen
        if isinstance(table, Objective):
            return table
        return Objective.model_validate(table.model_dump(include=set(Matching.model_fields) - {"presence"}))
