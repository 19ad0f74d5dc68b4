"""The score table of a run: exactly what `b23d scores RUN --json` prints. Ratios in 0 … 1; sd is the sample's, over draws of shots."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class _Row(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class Spread(_Row):
    """One figure over draws of shots."""

    mean: float
    sd: float
    """0 where there is one draw."""


class Curve(_Row):
    """One figure per threshold over draws of shots; both lists are as long as the table's thresholds."""

    mean: list[float]
    sd: list[float]


class Presence(_Row):
    """How well ids are judged present, wherever they are predicted."""

    precision: Spread
    """Of the ids predicted, how many the target has."""
    recall: Spread
    """Of the ids that the target has and some shot has, too, how many are predicted."""


class ClassScores(_Row):
    """All figures of one class, or their mean over classes."""

    targets: int
    """Shapes scored at least once; in the mean, of all classes together."""
    draws: int
    """Draws of shots that mean and sd are taken over."""
    thresholds: list[float]
    iou: Curve
    """Label-agnostic and many-to-one (KeypointNet, UKPGAN): TP / (TP + FP + FN), summed over the class's targets."""
    auc: Spread
    """Mean of `iou` over the thresholds."""
    pck: Curve
    """Annotated keypoints whose own id is predicted within the threshold."""
    symmetric_pck: Curve
    """The same after each shape's best exchange of ids that a symmetry permits."""
    one_to_one: Curve
    """As `iou`, with each prediction matched to at most one keypoint."""
    presence: Presence
    ceiling: float
    """IoU of a predictor that puts every id of the shots in its place wherever the target has it."""
    annotation_files: list[str]
    """sha256 of the annotation files the keypoints came from."""


class ScoreTable(_Row):
    """Scores of a run, by class."""

    run: str
    protocol: str
    classes: dict[str, ClassScores]
    mean: ClassScores
    """Over classes in each draw, then over draws; draws that some class lacks are left out of it."""
