"""What `optimize` can be told: the method, and each method's own table. What concerns the shots is `learn`'s."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from b23d.schemas.params import Params, When
from b23d.stages.solvers.hungarian import Assignment
from b23d.stages.solvers.posterior.options import PosteriorParams
from b23d.stages.solvers.presence import Presence


class Adam(Params):
    """The paper's optimiser of its relaxation."""

    beta: float = Field(default=0.0, ge=0)
    """Weight of the paper's selection reward R, which is constant on choices. The paper finds 0 best."""
    steps: int = Field(default=5000, ge=1)
    """DIFFERENCES.md, row 11."""
    learning_rate: float = Field(default=0.1, gt=0)
    """DIFFERENCES.md, row 11."""


class Softmax(Adam):
    """The paper's relaxation, with − β R in its objective."""

    one_to_one: bool = False
    """No candidate for two keypoints."""
    seed: int = Field(default=0, ge=0)
    """Of the initial S."""


class Discrete(Params):
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


class Hungarian(Params):
    """Linear assignment by feature distance."""

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
    alpha: float = Field(default=0.25, ge=0)
    """Weight of the distance term in the paper's objective, which "discrete" and "softmax" minimise; of other methods'
    choices it is told all the same. It depends on the scale of the features, `learn`'s `template.features`: .25 suits
    those of length 1; the paper has 4 with raw DINOv2."""
    retrieval: bool = False
    """Use only the shot whose class token is nearest to the target's by cosine (mean feature, where an encoder has no
    class token)."""
    presence: Presence = "evidence"
    """Which ids to predict (DIFFERENCES.md, row 22): "all" that any shot has (the paper); "majority": those of more
    than half of the shots; "evidence": groups of ids that are expected to be hit, by "posterior"; the other methods
    have no evidence, and predict all."""
    posterior: Annotated[PosteriorParams, When(method="posterior")] = PosteriorParams()
    discrete: Annotated[Discrete, When(method="discrete")] = Discrete()
    softmax: Annotated[Softmax, When(method="softmax")] = Softmax()
    hungarian: Annotated[Hungarian, When(method="hungarian")] = Hungarian()
