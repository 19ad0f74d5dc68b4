"""SAM's image encoder: Kirillov et al., "Segment anything" (2023), last layer before the neck.

It has no class token: `class_tokens` is None, and retrieval falls back on the mean of a shape's point features.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from b23d.stages.encoders.interface import Backbone, Settings, blocks_taken, no_layernorm
from b23d.stages.encoders.vit import IMAGENET_MEAN, IMAGENET_STD, Blocks, load_model, pixels_of
from b23d.stages.encoders.weights import Checkpoint


class Sam(Blocks):
    """Patch tokens of the blocks wanted. The neck is taken off: nothing here reads it."""

    def __init__(self, model: Any, blocks: tuple[int, ...]) -> None:
        super().__init__(model, blocks)
        model.vision_encoder.neck = nn.Identity()

    def forward(self, pixels: Tensor, kept: None = None) -> tuple[Tensor, None]:
        taken, _ = self.run(pixels)
        return torch.cat(taken, -1).flatten(1, 2), None


def build(checkpoint: Checkpoint, settings: Settings) -> Backbone:
    """Default: the last block. Views are resized to the encoder's own size (1024), the only one it takes.

    SAM's processor resizes the longest side and pads the other; views here are resized whole, which for square views is
    the same.
    """
    from transformers import SamVisionModel

    no_layernorm(checkpoint.encoder, settings.layernorm)
    model = load_model(SamVisionModel, checkpoint)
    config = model.config
    if settings.input_size not in (None, config.image_size):
        raise ValueError(
            f"encoder {checkpoint.encoder}: expected stages.extract.input_size {config.image_size}, SAM's only one, "
            f"got {settings.input_size}; remove it"
        )
    blocks = blocks_taken(checkpoint.encoder, settings.blocks, config.num_hidden_layers, config.num_hidden_layers - 1)
    grid = (config.image_size // config.patch_size, config.image_size // config.patch_size)
    pixels = pixels_of(checkpoint, config.image_size, IMAGENET_MEAN, IMAGENET_STD, "bilinear")
    # Whole: all but its global blocks attend within windows of 14 × 14 patches, whose relative positions are added as a
    # full grid. One view at 1024² is 4,096 tokens: as many as 16 views of a ViT-S/14 at 224².
    return Backbone(
        Sam(model, blocks),
        pixels,
        grid,
        config.hidden_size * len(blocks),
        class_token=False,
        likes_bf16=True,
        batch=1,
        whole=True,
    )
