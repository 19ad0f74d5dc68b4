"""A trained detector, and what it says of a shape's points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from b23d.schemas.head import KeypointHead


@dataclass(frozen=True)
class HeadWeights:
    """logits = hidden(x) @ weights + biases with x = (input − mean) / scale; all float32, shapes as in
    `KeypointHead`."""

    ids: np.ndarray
    mean: np.ndarray
    scale: np.ndarray
    weights: np.ndarray
    biases: np.ndarray
    hidden_weights: np.ndarray | None
    hidden_biases: np.ndarray | None
    loss: float


def probabilities(detector: HeadWeights | KeypointHead, inputs: np.ndarray) -> npt.NDArray[np.float32]:
    """How likely each point (n, input) is the keypoint of each id: (n, k) in 0 … 1."""
    x = (inputs - detector.mean) / detector.scale
    if detector.hidden_weights is not None:
        x = np.maximum(x @ detector.hidden_weights + detector.hidden_biases, 0)
    logits = (x @ detector.weights + detector.biases).astype(np.float64)
    return (1 / (1 + np.exp(-np.clip(logits, -80, 80)))).astype(np.float32)
