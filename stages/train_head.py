"""train_head: train a compact keypoint detector on the shots' features: a learned baseline beside `optimize`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.head import KeypointHead
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.params import Params, When
from b23d.schemas.shape import NormalizedShape


class Hidden(Params):
    width: int = Field(default=32, ge=1)
    """Rectified units, shared by all ids."""
    seed: int = Field(default=0, ge=0)
    """Of the initial weights."""


class TrainHeadParams(Params):
    """What is trained, and how. Defaults fit a few shots of 2,048 candidates: about a second on one core."""

    features: Literal["raw", "centred", "centred-unit", "standardised"] = "centred-unit"
    """Scale of the features, each shape by itself, as `learn` has it; every channel is then standardised over all
    shots."""
    context: float = Field(default=0.2, ge=0)
    """σ of the Gaussian geodesic neighbourhood whose mean feature joins each point's own, in units of the shape's
    largest distance; 0: none."""
    sigma: float = Field(default=0.02, gt=0)
    """σ of the heat maps exp(−d² / 2σ²) around the shots' keypoints that are to be reproduced, in the same unit."""
    detector: Literal["linear", "hidden"] = "linear"
    """"linear": every id has a linear detector of its own. "hidden": with a hidden layer before them."""
    hidden: Annotated[Hidden, When(detector="hidden")] = Hidden()
    components: int = Field(default=64, ge=1)
    """Leading principal components of the inputs that training is confined to (all there are, if fewer): faster, and
    less to fit."""
    steps: int = Field(default=200, ge=1)
    """Adam steps over all candidates of all shots at once."""
    learning_rate: float = Field(default=0.01, gt=0)
    """Of Adam."""
    weight_decay: float = Field(default=1.0, ge=0)
    """Decoupled (AdamW): each step shrinks the weights by learning_rate × this."""
    absent: Literal["calibrated", "never"] = "calibrated"
    """"calibrated": an id is judged absent below the probability that best separates ids present and absent on held-out
    shots. "never": every id of the shots is predicted."""


@stage(version=1, hints=Hints(memory_gb=1.0))
def train_head(
    shot_normalize: list[NormalizedShape],
    shot_reweight: list[PointFeatures],
    shot_geodesic: list[GeodesicDistances],
    shot_keypoints: list[Keypoints],
    params: TrainHeadParams,
) -> KeypointHead:
    """A per-point detector of every id that some shot has. It sees the shots only, so that one serves all targets of a
    draw.

    Minimises the balanced cross-entropy between predicted probabilities and heat maps: in each id's map the points near
    its keypoint weigh, all together, as much as the rest. A shot without the id has an empty map.

    Raises ValueError: no keypoint in any shot; features or distances that do not fit the candidates or are not finite;
    features of different encoders; a keypoint beyond the cloud.
    """
    import numpy as np

    from b23d.stages.heads.calibration import held_out_peaks, threshold
    from b23d.stages.heads.inputs import example
    from b23d.stages.heads.training import Options, train
    from b23d.stages.solvers.shots import labelled

    shots = labelled(shot_normalize, shot_reweight, shot_geodesic, shot_keypoints)
    examples = [example(shot, params.features, params.context, params.sigma) for shot in shots]
    hidden = params.hidden if params.detector == "hidden" else None
    options = Options(
        width=hidden.width if hidden else 0,
        components=params.components,
        steps=params.steps,
        learning_rate=params.learning_rate,
        weight_decay=params.weight_decay,
        seed=hidden.seed if hidden else 0,
    )
    head = train(examples, options)
    peaks = np.full((len(examples), len(head.ids)), np.nan, np.float32)
    if params.absent == "calibrated":
        peaks = held_out_peaks(examples, head.ids, options)
    has = np.stack([np.isin(head.ids, one.ids) for one in examples])
    return KeypointHead(
        ids=head.ids,
        mean=head.mean,
        scale=head.scale,
        weights=head.weights,
        biases=head.biases,
        hidden_weights=head.hidden_weights,
        hidden_biases=head.hidden_biases,
        threshold=threshold(peaks, has),
        features=params.features,
        context=params.context,
        loss=head.loss,
        held_out=peaks,
        shots=[str(i) for i in range(len(examples))],
        descriptor=shot_reweight[0].descriptor,
    )
