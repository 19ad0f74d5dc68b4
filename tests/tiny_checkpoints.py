"""Small random checkpoints of every family, saved as the hub has them, and what the library itself makes of them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import transformers

IMAGENET = {"image_mean": [0.485, 0.456, 0.406], "image_std": [0.229, 0.224, 0.225]}
HALF = {"image_mean": [0.5, 0.5, 0.5], "image_std": [0.5, 0.5, 0.5]}
VIT = {"hidden_size": 32, "num_hidden_layers": 3, "num_attention_heads": 2, "intermediate_size": 64}
TEXT = {**VIT, "vocab_size": 20, "max_position_embeddings": 8}


@dataclass(frozen=True)
class Tiny:
    """One family: how to make its checkpoint, and its own answer for pixels (b, 3, s, s): hidden states, patch tokens,
    class token."""

    make: Callable[[], Any]
    reader: str
    size: int
    """Input side used in tests."""
    grid: int
    processor: dict[str, Any]
    prefix: int
    """Rows of hidden states before the patches'."""
    class_rule: Callable[[Any, Any], torch.Tensor | None] = lambda model, output: output.pooler_output


def _clip() -> Any:
    vision = {**VIT, "image_size": 32, "patch_size": 8}
    return transformers.CLIPModel(transformers.CLIPConfig(text_config=TEXT, vision_config=vision, projection_dim=16))


def _sam() -> Any:
    vision = {
        "hidden_size": 32,
        "num_hidden_layers": 3,
        "num_attention_heads": 2,
        "mlp_dim": 64,
        "output_channels": 16,
        "image_size": 80,
        "patch_size": 16,
        "window_size": 3,
        "global_attn_indexes": [2],
        "num_pos_feats": 8,
    }
    prompt = {"hidden_size": 16, "image_size": 80, "patch_size": 16, "mask_input_channels": 4}
    decoder = {
        "hidden_size": 16,
        "mlp_dim": 16,
        "num_hidden_layers": 1,
        "num_attention_heads": 2,
        "iou_head_hidden_dim": 16,
    }
    return transformers.SamModel(
        transformers.SamConfig(vision_config=vision, prompt_encoder_config=prompt, mask_decoder_config=decoder)
    )


def _siglip() -> Any:
    return transformers.SiglipModel(
        transformers.SiglipConfig(text_config=TEXT, vision_config={**VIT, "image_size": 32, "patch_size": 8})
    )


def _siglip2() -> Any:
    vision = {**VIT, "num_patches": 16, "patch_size": 8}
    return transformers.Siglip2Model(transformers.Siglip2Config(text_config=TEXT, vision_config=vision))


def _efficientnet() -> Any:
    shape = {"width_coefficient": 0.25, "depth_coefficient": 0.4, "hidden_dim": 320, "image_size": 96}
    return transformers.EfficientNetForImageClassification(transformers.EfficientNetConfig(**shape, num_labels=5))


def _dino(kind: str, **options: Any) -> Callable[[], Any]:
    common = {"hidden_size": 32, "num_hidden_layers": 3, "num_attention_heads": 2, **options}
    return lambda: getattr(transformers, f"{kind}Model")(getattr(transformers, f"{kind}Config")(**common))


TINY = {
    "dinov2": Tiny(_dino("Dinov2", image_size=98), "Dinov2Model", 70, 5, IMAGENET, 1),
    "dinov2-giant": Tiny(_dino("Dinov2", image_size=98, use_swiglu_ffn=True), "Dinov2Model", 70, 5, IMAGENET, 1),
    "dinov2-reg": Tiny(
        _dino("Dinov2WithRegisters", image_size=98, patch_size=14, num_register_tokens=4),
        "Dinov2WithRegistersModel",
        70,
        5,
        IMAGENET,
        5,
    ),
    "dinov3": Tiny(
        _dino("DINOv3ViT", intermediate_size=64, num_register_tokens=4), "DINOv3ViTModel", 80, 5, IMAGENET, 5
    ),
    "clip": Tiny(
        _clip, "CLIPVisionModel", 32, 4, {"image_mean": [0.48, 0.46, 0.41], "image_std": [0.27, 0.26, 0.28]}, 1
    ),
    "sam": Tiny(_sam, "SamVisionModel", 80, 5, IMAGENET, 0, lambda model, output: None),
    "siglip": Tiny(_siglip, "SiglipVisionModel", 32, 4, HALF, 0),
    "siglip2": Tiny(_siglip2, "Siglip2VisionModel", 32, 4, HALF, 0),
    "efficientnet": Tiny(_efficientnet, "EfficientNetModel", 96, 3, IMAGENET, 0, lambda model, output: None),
}


def save(family: str, folder: Path, **processor: Any) -> Path:
    """A checkpoint of random weights in `folder`, every parameter away from its trivial start."""
    torch.manual_seed(0)
    model = TINY[family].make()
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(torch.randn_like(parameter) * 0.1)
        for name, buffer in model.named_buffers():
            if name.endswith("running_var"):
                buffer.uniform_(0.5, 2)
            elif name.endswith("running_mean"):
                buffer.normal_(0, 0.1)
    model.save_pretrained(folder)
    (folder / "preprocessor_config.json").write_text(json.dumps({**TINY[family].processor, "resample": 2, **processor}))
    return folder


def pixels(family: str, images: np.ndarray) -> torch.Tensor:
    """(level / 255 - mean) / std, written out once more."""
    mean, std = (torch.tensor(TINY[family].processor[key]).view(3, 1, 1) for key in ("image_mean", "image_std"))
    return (torch.from_numpy(images).permute(0, 3, 1, 2) / 255 - mean) / std


def library(
    family: str, folder: Path, images: np.ndarray
) -> tuple[list[torch.Tensor], torch.Tensor, torch.Tensor | None]:
    """The library's own forward pass in float32: hidden states after each block (b, i, j, c), final tokens (b, i, j,
    c), class token."""
    tiny = TINY[family]
    model = getattr(transformers, tiny.reader).from_pretrained(folder).eval()
    options: dict[str, Any] = {}
    x = pixels(family, images)
    if family == "siglip2":
        from transformers.models.siglip2.image_processing_pil_siglip2 import convert_image_to_patches

        x = torch.stack([torch.from_numpy(convert_image_to_patches(one.numpy(), 8)) for one in x])
        options = {
            "pixel_attention_mask": torch.ones(x.shape[:2], dtype=torch.int64),
            "spatial_shapes": torch.tensor([[4, 4]] * len(x)),
        }
    with torch.inference_mode():
        output = model(x, output_hidden_states=True, **options)
    if family == "efficientnet":
        return (
            [state.permute(0, 2, 3, 1) for state in output.hidden_states[1:]],
            output.last_hidden_state.permute(0, 2, 3, 1),
            None,
        )
    if family == "sam":
        return list(output.hidden_states[1:]), output.hidden_states[-1], None

    def grid(rows: torch.Tensor) -> torch.Tensor:
        return rows[:, tiny.prefix :].unflatten(1, (tiny.grid, tiny.grid))

    return (
        [grid(state) for state in output.hidden_states[1:]],
        grid(output.last_hidden_state),
        tiny.class_rule(model, output),
    )
