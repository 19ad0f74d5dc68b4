"""Training and use of a keypoint head: per-point detectors, linear or with one hidden layer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch

from b23d.stages.heads.detector import HeadWeights
from b23d.stages.heads.inputs import Example

LEAST = 1e-6


@dataclass(frozen=True)
class Options:
    width: int
    """Of the hidden layer; 0: none."""
    components: int
    steps: int
    learning_rate: float
    weight_decay: float
    seed: int


def train(examples: Sequence[Example], options: Options) -> HeadWeights:
    """A detector of every id of the examples; the same for the same inputs and seed (in one thread).

    Loss: for every example and id, the cross-entropy between probabilities and heat map, where the map's mass and the
    rest each weigh one half; an id that the example lacks has its whole weight on the rest. Mean over examples and ids.
    """
    ids = np.unique(np.concatenate([one.ids for one in examples])).astype(np.int32)
    stacked = np.concatenate([one.inputs for one in examples])
    mean = stacked.mean(0, dtype=np.float64).astype(np.float32)
    deviation = stacked.std(0, dtype=np.float64).astype(np.float32)
    scale = np.where(deviation > LEAST, deviation, np.float32(1))
    standard = (stacked - mean) / scale
    basis = principal(standard, options.components)
    inputs = torch.from_numpy(standard @ basis)
    near, far = (torch.from_numpy(w) for w in _weights(examples, ids))
    both = near + far

    random = torch.Generator().manual_seed(options.seed)
    hidden = options.width
    width = hidden or inputs.shape[1]
    layers = [torch.zeros(width, len(ids)), torch.zeros(len(ids))]
    if hidden:
        layers[0] = torch.randn(hidden, len(ids), generator=random) / hidden**0.5
        layers += [torch.randn(inputs.shape[1], hidden, generator=random) / inputs.shape[1] ** 0.5, torch.zeros(hidden)]
    for layer in layers:
        layer.requires_grad_()
    matrices, offsets = [p for p in layers if p.ndim == 2], [p for p in layers if p.ndim == 1]
    groups = [{"params": matrices, "weight_decay": options.weight_decay}, {"params": offsets, "weight_decay": 0.0}]
    optimiser = torch.optim.AdamW(groups, lr=options.learning_rate)
    loss = torch.zeros(())
    for _ in range(options.steps):
        optimiser.zero_grad()
        x = torch.relu(inputs @ layers[2] + layers[3]) if hidden else inputs
        logits = x @ layers[0] + layers[1]
        loss = (both * torch.nn.functional.softplus(logits) - near * logits).sum()  # −near log p − far log (1 − p)
        loss.backward()
        optimiser.step()
    weights, biases, *rest = (layer.detach().numpy() for layer in layers)
    if not hidden:
        return HeadWeights(ids, mean, scale, basis @ weights, biases, None, None, float(loss.detach()))
    return HeadWeights(ids, mean, scale, weights, biases, basis @ rest[0], rest[1], float(loss.detach()))


def principal(standard: np.ndarray, components: int) -> npt.NDArray[np.float32]:
    """The leading principal directions of (n, input) rows, (input, components), divided by the first one's standard
    deviation."""
    values, vectors = np.linalg.eigh(standard.T @ standard / len(standard))
    leading = vectors[:, ::-1][:, :components]
    largest = np.sqrt(max(float(values[-1]), LEAST))
    return np.ascontiguousarray(leading / largest, dtype=np.float32)


def _weights(examples: Sequence[Example], ids: np.ndarray) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Weights of log p and of log(1 − p), both (points of all examples, k); together they sum to 1."""
    near, far = [], []
    for one in examples:
        maps = np.zeros((len(one.inputs), len(ids)))
        maps[:, np.searchsorted(ids, one.ids)] = one.maps
        inside, outside = maps.sum(0), (1 - maps).sum(0)
        half = np.where(inside > 0, 0.5, 0.0)
        near.append(maps / np.maximum(inside, LEAST) * half)
        far.append((1 - maps) / np.maximum(outside, LEAST) * (1 - half))
    total = len(examples) * len(ids)
    return (np.concatenate(near) / total).astype(np.float32), (np.concatenate(far) / total).astype(np.float32)
