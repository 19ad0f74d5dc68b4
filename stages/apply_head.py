"""apply_head: find keypoints on a target with a trained head; gives what `optimize` gives."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.head import KeypointHead
from b23d.schemas.params import Params
from b23d.schemas.predictions import Prediction
from b23d.schemas.shape import NormalizedShape


class ApplyHeadParams(Params):
    """How a head's probabilities become keypoints."""

    separation: float = Field(default=0.05, ge=0)
    """Surer ids choose first, and no later one within this distance of them (in units of the shape's largest); 0: every
    id its best."""


@stage(version=2, hints=Hints(memory_gb=0.5))
def apply_head(
    normalize: NormalizedShape,
    reweight: PointFeatures,
    geodesic: GeodesicDistances,
    train_head: KeypointHead,
    params: ApplyHeadParams,
) -> Prediction:
    """The most probable candidate of every id; present where its probability reaches the head's threshold.

    `costs` are −log probability, `objective` their sum: comparable between heads, not with `optimize`'s.
    Raises ValueError: features of another encoder than the head's; features or distances that do not fit the candidates
    or are not finite.
    """
    from b23d.stages.heads.choosing import choose
    from b23d.stages.heads.detector import probabilities
    from b23d.stages.heads.inputs import shape_inputs
    from b23d.stages.solvers.shots import described

    target = described("the target", normalize, reweight, geodesic)
    inputs, lengths = shape_inputs(target, train_head.features, train_head.context)
    if inputs.shape[1] != len(train_head.mean):
        raise ValueError(
            f"features: expected inputs of {len(train_head.mean)} numbers as the head has ({train_head.descriptor}), "
            f"got {inputs.shape[1]} "
            f"on the target ({reweight.descriptor}); use one encoder for all"
        )
    likely = probabilities(train_head, inputs)
    chosen = choose(likely, lengths, params.separation)
    peaks = likely[chosen, np.arange(len(chosen))]
    costs = -np.log(np.maximum(peaks, np.finfo(np.float32).tiny))
    return Prediction(
        ids=train_head.ids,
        points=chosen.astype(np.int32),
        positions=normalize.points[chosen],
        present=peaks >= train_head.threshold,
        costs=costs.astype(np.float32),
        confidence=peaks.astype(np.float32),
        objective=float(costs.sum()),
        method="head",
        shots=train_head.shots,
    )
