"""orient: which axis of a shape's file points up, where the run says `dataset.up = "auto"`."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.orientation import ClassFrame, Orientation
from b23d.schemas.params import Params
from b23d.schemas.shape import Source
from b23d.schemas.up_axis import UP_AXES

SURE = 0.9
"""A less probable choice is told."""


class OrientParams(Params):
    count: int = Field(512, ge=16)
    """Points of the shape's surface."""
    turns: int = Field(24, ge=1)
    """Turns about each axis that are tried."""
    weight: float = Field(100.0, gt=0)
    """Log evidence for a unit of likeness; how sure the choice is grows with it."""


@stage(version=1, hints=Hints(memory_gb=0.3))
def orient(unoriented: Source, stand: ClassFrame | None, params: OrientParams) -> Orientation:
    """The axis with which the shape looks most like one of its class's examples, in the six axes and all turns about
    them: place in the box and the surface around it, point by point. No picture is rendered for it.

    Where the class has no examples, a flat underside says what is up, or else the shape stays as it is; either is told.
    Raises ValueError, naming the shape, where `normalize` does.
    """
    from b23d.stages.orienting.looks import described, hypotheses, sampled, unlike

    if stand is None:
        return _by_underside(unoriented)
    points = sampled(unoriented, params.count)
    examples = [described(stand.points[stand.example == i].astype(np.float64)) for i in range(len(stand.shapes))]
    scores = -params.weight * unlike(points, examples, hypotheses(params.turns))
    evidence = np.logaddexp.reduce(scores, axis=1) - np.log(params.turns)
    odds = np.exp(evidence - evidence.max())
    order = np.argsort(-evidence, kind="stable")
    axis, probability = UP_AXES[order[0]], float(odds[order[0]] / odds.sum())
    warnings = []
    if probability < SURE:
        warnings.append(
            f"{unoriented.shape}: up is {axis} by a probability of {probability:.2f}, next {UP_AXES[order[1]]}; look "
            "at it, and say it with dataset.up if that is wrong"
        )
    return Orientation(axis=axis, probability=probability, evidence=evidence, warnings=warnings)


def _by_underside(source: Source) -> Orientation:
    from b23d.stages.geometry.upright import stance
    from b23d.stages.normalize import NormalizeParams, normalize

    alone = NormalizeParams(candidates="fps", count=1, colors=False, max_nonfinite=1.0)
    shape = normalize(source.model_copy(update={"up": "y"}), alone)
    found = stance(shape.vertices, shape.faces) if shape.kind == "mesh" else None
    told = "it stands on a flat side" if found is not None else "nothing tells, so it stays as it is"
    warning = f"{source.shape}: up is {found.axis if found else 'y'}: no shape of its class is annotated, and {told}"
    return Orientation(
        axis="y" if found is None else found.axis,
        probability=None,
        evidence=np.zeros(len(UP_AXES)),
        warnings=[f"{warning}; annotate some, or say it with dataset.up"],
    )
