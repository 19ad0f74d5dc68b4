"""CLIP's image tower: Radford et al., "Learning transferable visual models from natural language supervision"
(2021)."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from b23d.stages.encoders.interface import Backbone, Settings, blocks_taken, size_taken
from b23d.stages.encoders.vit import BATCH, Blocks, load_model, pixels_of
from b23d.stages.encoders.weights import Checkpoint

MEAN, STD = (0.48145466, 0.4578275, 0.40821073), (0.26862954, 0.26130258, 0.27577711)


class Clip(Blocks):
    """Patch tokens of the blocks wanted, as they are or after the final layer norm; the class token always after it, as
    CLIP has it."""

    def __init__(self, model: Any, blocks: tuple[int, ...], layernorm: bool, interpolate: bool) -> None:
        super().__init__(model, blocks, prefix=1)
        self.norm, self.layernorm, self.interpolate = self.named("post_layernorm"), layernorm, interpolate

    def forward(self, pixels: Tensor, kept: Tensor | None = None) -> tuple[Tensor, Tensor]:
        taken, _ = self.run(pixels, kept, interpolate_pos_encoding=self.interpolate)
        patches = torch.cat([self.norm(one[:, 1:]) if self.layernorm else one[:, 1:] for one in taken], -1)
        return patches, torch.cat([self.norm(one[:, 0]) for one in taken], -1)


def build(checkpoint: Checkpoint, settings: Settings) -> Backbone:
    """Default: the last block's patch tokens (`last_hidden_state`), before the final layer norm, which CLIP keeps for
    the class token."""
    from transformers import CLIPVisionModel

    model = load_model(CLIPVisionModel, checkpoint)
    config = model.config
    blocks = blocks_taken(checkpoint.encoder, settings.blocks, config.num_hidden_layers, config.num_hidden_layers - 1)
    size = size_taken(checkpoint.encoder, settings.input_size, config.image_size, config.patch_size)
    grid = (size // config.patch_size, size // config.patch_size)
    network = Clip(model, blocks, bool(settings.layernorm), interpolate=size != config.image_size)
    pixels = pixels_of(checkpoint, size, MEAN, STD)
    return Backbone(
        network, pixels, grid, config.hidden_size * len(blocks), class_token=True, likes_bf16=True, batch=BATCH
    )
