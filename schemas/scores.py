"""Scores of one prediction against one annotation, and the tables of a run made of them.

Tables are exactly what `b23d scores RUN --json` and `b23d parts RUN --json` print. Ratios in 0 … 1; sd is the sample's,
over draws of shots.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict

from b23d.schemas.artifact import ArraySpec, Artifact


class ShapeScore(Artifact):
    """How one prediction compares with one annotation, at every threshold. Sums over a class give its
    micro-averages."""

    thresholds: Annotated[np.ndarray, ArraySpec("t", "float64", unit="data set's units")]
    true_positives: Annotated[np.ndarray, ArraySpec("t", "int32")]
    """Label-agnostic, many-to-one (KeypointNet, UKPGAN): annotated keypoints with a prediction within the threshold."""
    false_positives: Annotated[np.ndarray, ArraySpec("t", "int32")]
    false_negatives: Annotated[np.ndarray, ArraySpec("t", "int32")]
    matched: Annotated[np.ndarray, ArraySpec("t", "int32")]
    """Pairs of the largest one-to-one matching within the threshold, label-agnostic."""
    labelled: Annotated[np.ndarray, ArraySpec("t", "int32")]
    """Annotated keypoints whose own id is predicted within the threshold (labelled PCK's numerator)."""
    symmetric: Annotated[np.ndarray, ArraySpec("t", "int32")]
    """The same after the best exchange of ids that a symmetry of the shape permits."""
    either_front: Annotated[np.ndarray, ArraySpec("t", "int32")]
    """As `labelled`, with the front where it was annotated or opposite, whichever meets more: all ids that a half turn
    takes to one another are exchanged, front with back and left with right, or none, whether the shape is symmetric or
    not."""
    annotated: int
    predicted: int
    common: int
    """Ids both predicted and annotated: presence's true positives."""
    ceiling: Annotated[np.ndarray, ArraySpec("2", "int32", unit="intersection, union")]
    """Ids seen in the shots against ids annotated: the IoU of a perfect labelled predictor that predicts every id of
    the shots."""
    distances: Annotated[np.ndarray, ArraySpec("k g", "float32", unit="data set's units")]
    """Geodesic distance of every present prediction from every annotated keypoint."""
    protocol: str
    annotation_file: str
    """sha256 of the annotation file the keypoints came from (KeypointNet's labels have drifted over the years)."""


class PartScore(Artifact):
    """How one transferred segmentation compares with one annotation, part by part."""

    intersection: Annotated[np.ndarray, ArraySpec("part", "int32", unit="annotated points")]
    """Points that are annotated and predicted as the part."""
    union: Annotated[np.ndarray, ArraySpec("part", "int32", unit="annotated points")]
    """Points that are annotated or predicted as the part."""
    present: Annotated[np.ndarray, ArraySpec("part", "bool")]
    """Whether the annotation has the part."""
    iou: float
    """Mean of intersection / union over the parts, by `protocol`; 0 … 1."""
    names: list[str]
    protocol: str


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


class PresenceScores(_Row):
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
    either_front_pck: Curve
    """As `pck`, with each shape's front where it was annotated or opposite, whichever is better. What it is above `pck`
    is what choosing the front costs."""
    one_to_one: Curve
    """As `iou`, with each prediction matched to at most one keypoint."""
    presence: PresenceScores
    ceiling: float
    """IoU of a predictor that puts every id of the shots in its place and judges none absent."""
    annotation_files: list[str]
    """sha256 of the annotation files the keypoints came from."""


class ScoreTable(_Row):
    """Scores of a run, by class."""

    run: str
    protocol: str
    classes: dict[str, ClassScores]
    mean: ClassScores
    """Over classes in each draw, then over draws; draws that some class lacks are left out of it."""


class PartClass(_Row):
    """One class. Ratios in 0 … 1; mean and the sample's sd over draws of shots."""

    targets: int
    """Shapes scored at least once."""
    draws: int
    iou: Spread
    """Mean over shapes of each shape's mean IoU over parts."""
    parts: dict[str, float | None]
    """Part → mean IoU over draws and the shapes that have it; None where no target has it."""


class PartTable(_Row):
    """Scores of transferred parts, by class: exactly what `b23d parts RUN --json` prints."""

    run: str
    protocol: str
    classes: dict[str, PartClass]
    mean: Spread
    """Over classes in each draw, then over draws; draws that some class lacks are left out."""
    instances: Spread
    """Over all shapes of a draw, whatever their class, then over draws."""
