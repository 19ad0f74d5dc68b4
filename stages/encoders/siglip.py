"""SigLIP and SigLIP 2 image towers: Zhai et al. (2023), Tschannen et al., "SigLIP 2" (2025).

They have no class token; an attention-pooling head gives one vector an image, which serves as such where the last block
alone is taken (of earlier or several blocks there is none).
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.nn import functional

from b23d.stages.encoders.interface import Backbone, Settings, blocks_taken, size_taken
from b23d.stages.encoders.vit import BATCH, Blocks, load_model, pixels_of, vision_config
from b23d.stages.encoders.weights import CONFIG, Checkpoint, read_json

MEAN = STD = (0.5, 0.5, 0.5)


class Siglip(Blocks):
    """Patch tokens of the blocks wanted, each after the final layer norm if so set; the pooled output if so set."""

    def __init__(
        self, model: Any, blocks: tuple[int, ...], layernorm: bool, grid: tuple[int, int], pooled: bool
    ) -> None:
        super().__init__(model, blocks)
        self.norm = self.named("post_layernorm") if layernorm else None
        self.grid, self.pooled = grid, pooled

    def forward(self, pixels: Tensor, kept: Tensor | None = None) -> tuple[Tensor, Tensor | None]:
        taken, output = self.run(pixels, kept, **self.options(pixels, kept))
        patches = torch.cat([self.norm(one) if self.norm is not None else one for one in taken], -1)
        return patches, output.pooler_output if self.pooled else None

    def options(self, pixels: Tensor, kept: Tensor | None) -> dict[str, Any]:
        # Interpolation to the size of training is the identity; the model checks that itself.
        return {"interpolate_pos_encoding": True}


class NaFlex(Siglip):
    """The variant that takes patches of any grid in place of an image."""

    def run(self, pixels: Tensor, kept: Tensor | None = None, **options: Any) -> tuple[list[Tensor], Any]:
        patch = self.model.config.patch_size
        patches = functional.pixel_unshuffle(pixels, patch).unflatten(1, (3, patch, patch))  # b, rgb, y, x, i, j
        rows = patches.permute(0, 4, 5, 2, 3, 1).flatten(3).flatten(1, 2)  # b, patches, y x rgb
        return super().run(rows, kept, **options)

    def options(self, pixels: Tensor, kept: Tensor | None) -> dict[str, Any]:
        count, device = self.grid[0] * self.grid[1] if kept is None else kept.shape[1], pixels.device
        return {
            "pixel_attention_mask": torch.ones(len(pixels), count, dtype=torch.int64, device=device),
            "spatial_shapes": torch.tensor([self.grid] * len(pixels), device=device),
        }


def build(checkpoint: Checkpoint, settings: Settings) -> Backbone:
    """Default: the last block, after the final layer norm (`last_hidden_state`)."""
    from transformers import Siglip2VisionModel, SiglipVisionModel

    naflex = str(read_json(checkpoint.path / CONFIG)["model_type"]).startswith("siglip2")
    model = load_model(Siglip2VisionModel if naflex else SiglipVisionModel, checkpoint)
    config = model.config
    own = round(config.num_patches**0.5) * config.patch_size if naflex else config.image_size
    last = config.num_hidden_layers - 1
    blocks = blocks_taken(checkpoint.encoder, settings.blocks, config.num_hidden_layers, last)
    size = size_taken(
        checkpoint.encoder, settings.input_size, own // config.patch_size * config.patch_size, config.patch_size
    )
    grid = (size // config.patch_size, size // config.patch_size)
    pooled = blocks == (last,) and vision_config(checkpoint).get("vision_use_head", True)
    network = (NaFlex if naflex else Siglip)(model, blocks, settings.layernorm is not False, grid, pooled)
    pixels = pixels_of(checkpoint, size, MEAN, STD, "bilinear" if naflex else "bicubic")
    return Backbone(
        network, pixels, grid, config.hidden_size * len(blocks), class_token=pooled, likes_bf16=True, batch=BATCH
    )
