"""KeypointHead: a small network, trained on the shots of one draw, that tells keypoints from features."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from b23d.schemas.artifact import ArraySpec, Artifact


class KeypointHead(Artifact):
    """Per-point classifiers, one a keypoint id; what `train_head` gives and `apply_head` uses.

    A point's logits are `hidden(x) @ weights + biases` for its standardised input x = (input − mean) / scale, where
    `hidden(x) = max(x @ hidden_weights + hidden_biases, 0)`, or x itself where there is no hidden layer.
    """

    ids: Annotated[np.ndarray, ArraySpec("k", "int32")]
    """Every id that some shot has, sorted."""
    mean: Annotated[np.ndarray, ArraySpec("input", "float32")]
    """Of the inputs over the shots' candidates. Inputs: the scaled feature, then (where `context` > 0) its
    neighbourhood's mean."""
    scale: Annotated[np.ndarray, ArraySpec("input", "float32")]
    weights: Annotated[np.ndarray, ArraySpec("hidden k", "float32")]
    biases: Annotated[np.ndarray, ArraySpec("k", "float32")]
    hidden_weights: Annotated[np.ndarray, ArraySpec("input hidden", "float32")] | None = None
    hidden_biases: Annotated[np.ndarray, ArraySpec("hidden", "float32")] | None = None
    threshold: float
    """An id is judged present where its largest probability on the target reaches this; 0: always."""
    features: Literal["raw", "centred", "centred-unit", "standardised"]
    """Scale of the features, as `learn`'s template has it."""
    context: float
    """σ of the Gaussian geodesic neighbourhood whose mean feature joins the input, in units of the largest distance; 0:
    none."""
    loss: float
    """Of the last step."""
    held_out: Annotated[np.ndarray, ArraySpec("shot k", "float32")]
    """Largest probability of each id on each shot, by a head trained on the other shots; NaN where those lack the
    id."""
    shots: list[str]
    """Indices of the shots it was trained on, as text."""
    descriptor: str
    """What made the features."""
