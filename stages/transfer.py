"""transfer: carry part labels from the shots to a target, by nearest neighbours in feature space."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.features import PointFeatures
from b23d.schemas.params import Params
from b23d.schemas.parts import Parts
from b23d.schemas.predictions import PartPrediction
from b23d.schemas.shape import NormalizedShape


class TransferParams(Params):
    """How labels are carried over. The paper (supplement, part segmentation transfer) says "k-nearest neighbour", one
    shape to another."""

    k: int = Field(default=5, ge=1)
    """Candidates of the shots, all shots together, that vote for a target's candidate (all there are, if fewer)."""
    weighting: Literal["similarity", "uniform"] = "similarity"
    """A vote's weight: 1 + cosine, or 1. Equal sums go to the part with the lower index."""
    features: Literal["raw", "centred", "centred-unit", "standardised"] = "centred-unit"
    """Scale of the features before the cosine, each shape by itself, as `learn` has it; "raw" and "centred" differ
    in the mean only."""


@stage(version=1, hints=Hints(memory_gb=0.5))
def transfer(
    normalize: NormalizedShape,
    reweight: PointFeatures,
    shot_normalize: list[NormalizedShape],
    shot_reweight: list[PointFeatures],
    shot_parts: list[Parts],
    params: TransferParams,
) -> PartPrediction:
    """A part label for every candidate of the target.

    A shot's candidate has the label of the annotated point nearest to it.
    Raises ValueError: no labelled point in a shot, labels that `names` does not hold, shots whose parts have other
    names, features of different encoders or that do not fit the candidates or are not finite.
    """
    from b23d.stages.geometry.parts import candidate_labels, part_names
    from b23d.stages.solvers.shots import check_fit
    from b23d.stages.solvers.voting import directions, vote

    names = part_names({f"shot {i}": parts for i, parts in enumerate(shot_parts)})
    check_fit("the target", normalize, reweight)
    target = directions(reweight, params.features)
    shots, known = [], []
    for i, (shape, features, parts) in enumerate(zip(shot_normalize, shot_reweight, shot_parts, strict=True)):
        check_fit(f"shot {i}", shape, features)
        shots.append(directions(features, params.features))
        known.append(candidate_labels(parts, shape, f"shot {i}"))
    channels = sorted({len(shape[0]) for shape in (target, *shots)})
    if len(channels) > 1:
        raise ValueError(
            f"features: expected as many channels in the target and all shots, got {channels}; use one encoder for all"
        )
    labels, confidence = vote(
        target, np.concatenate(shots), np.concatenate(known), len(names), params.k, params.weighting
    )
    return PartPrediction(
        labels=labels,
        confidence=confidence,
        names=names,
        method=f"{params.k}-nearest neighbours, {reweight.descriptor}",
    )
