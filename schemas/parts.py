"""Part labels carried over to a target, their scores, and the table of a run."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict

from schemas.artifact import ArraySpec, Artifact
from schemas.scores import Spread


class PartPrediction(Artifact):
    """A part label for every candidate of one target; what `transfer` gives."""

    labels: Annotated[np.ndarray, ArraySpec("n", "int32")]
    """Index into `names`."""
    confidence: Annotated[np.ndarray, ArraySpec("n", "float32", unit="share of the votes, 0 … 1")]
    names: list[str]
    """The parts of the category, whether or not they occur in the shots."""
    method: str


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
