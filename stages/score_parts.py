"""score_parts: compare transferred part labels with annotated ones, as ShapeNetPart does."""

from __future__ import annotations

from typing import Literal

import numpy as np

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.params import Params
from b23d.schemas.parts import Parts
from b23d.schemas.predictions import PartPrediction
from b23d.schemas.scores import PartScore
from b23d.schemas.shape import NormalizedShape


class PartScoreParams(Params):
    """What counts."""

    absent: Literal["one", "skip"] = "one"
    """A part of the category that is neither annotated nor predicted: "one" counts it with IoU 1 (ShapeNetPart), "skip"
    leaves it out."""


@stage(version=1, hints=Hints(memory_gb=0.3))
def score_parts(
    normalize: NormalizedShape, transfer: PartPrediction, parts: Parts, params: PartScoreParams
) -> PartScore:
    """Intersection and union of every part over the annotated points, each of which takes the nearest candidate's
    label.

    The shape's IoU is the mean over all parts of its category (Yi et al., A Scalable Active Framework for Region
    Annotation in 3D Shape Collections, SIGGRAPH Asia 2016). Raises ValueError: no annotated points, other part names
    than the shots have, labels that do not fit the candidates.
    """
    from b23d.stages.geometry.parts import at_annotated, part_names

    if len(transfer.labels) != len(normalize.points):
        n, got = len(normalize.points), len(transfer.labels)
        raise ValueError(f"labels: expected one for each of {n} candidates, got {got}; re-run transfer")
    carried = Parts(points=normalize.points.astype(np.float64), labels=transfer.labels, names=transfer.names)
    names = part_names({"the shots": carried, "the target": parts})
    predicted = at_annotated(transfer.labels, parts, normalize, "the target")
    labels = np.arange(len(names))[:, None]
    is_predicted, is_annotated = predicted == labels, parts.labels == labels  # (part, p)
    intersection, union = (is_predicted & is_annotated).sum(1), (is_predicted | is_annotated).sum(1)
    ratios = np.where(union > 0, intersection / np.maximum(union, 1), 1.0)
    counted = ratios if params.absent == "one" else ratios[union > 0]
    return PartScore(
        intersection=intersection.astype(np.int32),
        union=union.astype(np.int32),
        present=is_annotated.any(1),
        iou=float(counted.mean()),
        names=names,
        protocol=protocol(params),
    )


def protocol(params: PartScoreParams) -> str:
    """How these figures were made, in one line."""
    absent = "counts 1" if params.absent == "one" else "is left out"
    return f"mean IoU over a category's parts at the annotated points; a part neither there nor predicted {absent}"
