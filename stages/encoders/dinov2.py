"""DINOv2 (with and without registers) and DINOv3: self-supervised vision transformers, the paper's encoders.

Oquab et al., "DINOv2" (2023); Darcet et al., "Vision transformers need registers" (2023); Siméoni et al., "DINOv3"
(2025). Register tokens are dropped. Position embeddings of v2 are interpolated from the 37² grid of training; v3 has
rotary ones.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from b23d.stages.encoders.interface import Backbone, Settings, blocks_taken, size_taken
from b23d.stages.encoders.vit import BATCH, IMAGENET_MEAN, IMAGENET_STD, Blocks, load_model, pixels_of
from b23d.stages.encoders.weights import CONFIG, Checkpoint, read_json

INPUT_SIZE = 224
NORMS = {"dinov2": "layernorm", "dinov2_with_registers": "layernorm", "dinov3_vit": "norm"}


class Dino(Blocks):
    """Patch tokens and class token of the blocks wanted, each block's after the final layer norm if so set."""

    def __init__(self, model: Any, blocks: tuple[int, ...], layernorm: bool) -> None:
        super().__init__(model, blocks, prefix=1 + getattr(model.config, "num_register_tokens", 0))
        self.norm = self.named(NORMS[model.config.model_type]) if layernorm else None

    def forward(self, pixels: Tensor, kept: Tensor | None = None) -> tuple[Tensor, Tensor]:
        taken, _ = self.run(pixels, kept)
        normed = [self.norm(one) if self.norm is not None else one for one in taken]
        rows = torch.cat(normed, -1)  # b, 1 + registers + patches, channel
        return rows[:, self.prefix :], rows[:, 0]


def build(checkpoint: Checkpoint, settings: Settings) -> Backbone:
    """Default: the last block, after the final layer norm (`x_norm_patchtokens`, `x_norm_clstoken`)."""
    import transformers

    names = {
        "dinov2": "Dinov2Model",
        "dinov2_with_registers": "Dinov2WithRegistersModel",
        "dinov3_vit": "DINOv3ViTModel",
    }
    model = load_model(getattr(transformers, names[read_json(checkpoint.path / CONFIG)["model_type"]]), checkpoint)
    return backbone(checkpoint, model, settings, default_block=model.config.num_hidden_layers - 1, default_norm=True)


def backbone(
    checkpoint: Checkpoint, model: Any, settings: Settings, default_block: int, default_norm: bool
) -> Backbone:
    """A DINO-like transformers model as a backbone."""
    config = model.config
    blocks = blocks_taken(checkpoint.encoder, settings.blocks, config.num_hidden_layers, default_block)
    size = size_taken(
        checkpoint.encoder, settings.input_size, INPUT_SIZE // config.patch_size * config.patch_size, config.patch_size
    )
    grid = (size // config.patch_size, size // config.patch_size)
    norm = default_norm if settings.layernorm is None else settings.layernorm
    pixels = pixels_of(checkpoint, size, IMAGENET_MEAN, IMAGENET_STD)
    network = Dino(model, blocks, norm)
    return Backbone(
        network, pixels, grid, config.hidden_size * len(blocks), class_token=True, likes_bf16=True, batch=BATCH
    )
