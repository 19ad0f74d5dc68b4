"""What `optimize` can be told: the method, its objective, and what of the shots enters it."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from b23d.schemas.params import Params
from b23d.stages.solvers.posterior.options import PosteriorParams


class OptimizeParams(Params):
    """How keypoints are chosen. The objective is L = ‖F[c] − F_kp‖ + α ‖(D[c, c] − D_kp) ∘ M‖ − β R for all methods
    that have one."""

    method: Literal["posterior", "discrete", "softmax", "nearest", "hungarian"] = "posterior"
    """"posterior": the points of most expected hits under a model learned from the shots (`stages/solvers/posterior/`);
    where the shots stand differently about the up axis, they are turned onto each other and every target onto them. The
    others choose by the paper's objective or a part of it.
    "discrete": coordinate descent on the choice, from many starts. "softmax": the paper's relaxation, driven by Adam.
    "nearest": each keypoint's nearest feature. "hungarian": the linear assignment by feature distance. The last two use
    no α."""
    alpha: float = Field(default=0.25, ge=0)
    """Weight of the distance term. It depends on the scale of `features`: .25 suits those of length 1; the paper has 4
    with raw DINOv2."""
    beta: float = Field(default=0.0, ge=0)
    """Weight of the paper's selection reward R; "softmax" only, since R is constant on choices. The paper finds 0
    best."""
    features: Literal["raw", "centred", "centred-unit", "standardised"] = "centred-unit"
    """Scale of the features, each shape by itself. "raw": as extracted (the paper). "centred": less the shape's mean.
    "centred-unit": then each point's feature to length 1. "standardised": every channel to mean 0 and variance 1 /
    channels."""
    combine: Literal["mean", "sum_distances"] = "mean"
    """Several shots: "mean" averages features per id and distances per pair over the shots that have them (the paper);
    "sum_distances" averages features but sums distances (the published code)."""
    source_features: Literal["cloud", "keypoints"] = "cloud"
    """Features of the shots' keypoints: "cloud" takes them from the whole shot's smoothed features; "keypoints" smooths
    them among the shot's keypoints only, as the published code does. Whole-shape smoothing is `reweight`'s: set its σ
    to 0 to have this one alone."""
    source_sigma: float = Field(default=0.01, gt=0)
    """σ of `source_features = "keypoints"`, in units of the shot's largest distance."""
    distances: Literal["largest", "unit-frame"] = "largest"
    """Unit of the distance term: "largest" divides by each shape's own largest distance (the paper); "unit-frame" does
    not."""
    mask: Literal["pairs", "positive", "whole"] = "pairs"
    """M. "pairs": pairs of different ids that some shot has both of. "positive": entries of D_kp above 0 (the published
    code), so without pairs that coincide. "whole": as "pairs", and the diagonal (the paper's formula; only "softmax"
    can tell)."""
    seed: int = Field(default=0, ge=0)
    """Of "softmax"'s initial S and of "discrete"'s random starts."""
    steps: int = Field(default=5000, ge=0)
    """Adam steps of "softmax"."""
    learning_rate: float = Field(default=0.1, gt=0)
    """Of "softmax"'s Adam."""
    starts: int = Field(default=32, ge=1)
    """Starts of "discrete": nearest neighbour, assignment, and random ones."""
    sweeps: int = Field(default=100, ge=1)
    """Most sweeps over the keypoints of a start of "discrete"; one ends as soon as no move lowers its objective, after
    three to eight."""
    softmax_start: bool = False
    """Let "discrete" start from the softmax's result, too, which it is then never worse than. As slow as "softmax"."""
    one_to_one: bool = False
    """No candidate for two keypoints ("discrete" and "softmax"; "hungarian" never gives one twice)."""
    assignment: Literal["labelled", "sorted"] = "labelled"
    """"hungarian" only: "labelled" gives each id the candidate assigned to it; "sorted" gives the ids the same
    candidates in the order of their indices, as the published code does, whose labels are lost by that."""
    retrieval: bool = False
    """Use only the shot whose class token is nearest to the target's by cosine (mean feature, where an encoder has no
    class token)."""
    presence: Literal["all", "majority", "evidence"] = "evidence"
    """Which ids to predict: "all" that any shot has (the paper); "majority": those of more than half of the shots;
    "evidence": groups of ids that "posterior" expects to hit (`posterior.present`); methods without expectations then
    predict all."""
    posterior: PosteriorParams = PosteriorParams()
    """Constants of "posterior"."""

    @model_validator(mode="after")
    def _nearest_repeats(self) -> Self:
        if self.method == "nearest" and self.one_to_one:
            raise ValueError(
                'one_to_one: expected a method that can keep candidates apart, got "nearest"; use "hungarian"'
            )
        return self
