"""EfficientNet through transformers (B4 in the paper's comparison): Tan & Le, ICML 2019; the layer before the head.

It has no class token: `class_tokens` is None, and retrieval falls back on the mean of a shape's point features.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn

from b23d.stages.encoders.interface import Backbone, Settings, blocks_taken, joined, no_layernorm, tokens_of
from b23d.stages.encoders.vit import IMAGENET_MEAN, IMAGENET_STD, load_model, pixels_of
from b23d.stages.encoders.weights import Checkpoint

BATCH = 4


class EfficientNet(nn.Module):
    """Outputs of the MBConv blocks wanted, or, with none named, of the last convolution, before pooling and
    classifier."""

    def __init__(self, encoder: str, model: Any, blocks: tuple[int, ...]) -> None:
        super().__init__()
        self.encoder, self.model, self.blocks = encoder, model.to(memory_format=torch.channels_last), blocks

    def forward(self, pixels: Tensor, kept: None = None) -> tuple[Tensor, None]:
        return tokens_of(self.maps(pixels)), None

    def maps(self, pixels: Tensor) -> Tensor:
        """(b, channel, i, j)"""
        x, taken = self.model.embeddings(pixels), []
        network = self.model.encoder
        for index, block in enumerate(network.blocks[: max(self.blocks) + 1] if self.blocks else network.blocks):
            x = block(x)
            if index in self.blocks:
                taken.append(x)
        if not self.blocks:
            taken = [network.top_activation(network.top_bn(network.top_conv(x)))]
        return joined(self.encoder, taken)


def build(checkpoint: Checkpoint, settings: Settings) -> Backbone:
    """Default: the last convolution's output (`last_hidden_state`; B4: 1,792 channels, a grid of 12² at 380²)."""
    from transformers import EfficientNetModel

    no_layernorm(checkpoint.encoder, settings.layernorm)
    model = load_model(EfficientNetModel, checkpoint)
    if settings.blocks:
        blocks_taken(checkpoint.encoder, settings.blocks, len(model.encoder.blocks), default=0)
    size = settings.input_size or model.config.image_size
    network = EfficientNet(checkpoint.encoder, model, settings.blocks)
    with torch.inference_mode():
        _, channels, rows, columns = network.maps(torch.zeros(1, 3, size, size)).shape
    pixels = pixels_of(checkpoint, size, IMAGENET_MEAN, IMAGENET_STD)
    return Backbone(
        network, pixels, (rows, columns), channels, class_token=False, likes_bf16=False, batch=BATCH, whole=True
    )
