"""ClassFrame and Orientation: how the examples of a class stand, and which axis of another shape of it points up."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from b23d.schemas.artifact import ArraySpec, Artifact
from b23d.schemas.up_axis import UpAxis


class ClassFrame(Artifact):
    """The annotated examples of one class, upright and turned onto each other."""

    points: Annotated[np.ndarray, ArraySpec("p 3", "float32", unit="each example's own unit frame, upright")]
    """Of all examples, one after the other."""
    example: Annotated[np.ndarray, ArraySpec("p", "int32")]
    """Which example a point is of."""
    shapes: list[str]
    """Names of the examples."""
    axes: list[UpAxis]
    """Which axis of each example's file points up."""
    by: Literal["declared", "undersides", "as they are"]
    """What says so: `dataset.up` of one of them, flat undersides, or nothing: the first keeps its +y."""
    warnings: list[str] = []


class Orientation(Artifact):
    """Which axis of a shape's file points up, as the examples of its class have it."""

    axis: UpAxis
    probability: float | None
    """Of that axis among the six; None where there was nothing to compare with."""
    evidence: Annotated[np.ndarray, ArraySpec("axis", "float64")]
    """(6,) log evidence, up to a constant, of the axes y z x -x -y -z, each with its best turns; zeros where there was
    nothing to compare with."""
    warnings: list[str] = []
