"""From a checkpoint and what is wanted of it to an encoder on its device; loaded once a process."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Literal

import torch

from b23d.stages.encoders import clip, dinov2, efficientnet, efficientnet_lite0, saliency_vit, sam, siglip
from b23d.stages.encoders.interface import Backbone, Encoder, Settings
from b23d.stages.encoders.weights import CONFIG, Checkpoint, read_json

Precision = Literal["auto", "bf16", "fp32"]
Build = Callable[[Checkpoint, Settings], Backbone]
EMBEDDED: dict[str, Build] = {"efficientnet-lite0": efficientnet_lite0.build, "saliency-vit-s14": saliency_vit.build}
FAMILIES: dict[str, Build] = {
    "dinov2": dinov2.build,
    "dinov2_with_registers": dinov2.build,
    "dinov3_vit": dinov2.build,
    "clip": clip.build,
    "clip_vision_model": clip.build,
    "sam": sam.build,
    "sam_vision_model": sam.build,
    "siglip": siglip.build,
    "siglip_vision_model": siglip.build,
    "siglip2": siglip.build,
    "siglip2_vision_model": siglip.build,
    "efficientnet": efficientnet.build,
}
"""`model_type` of config.json → who builds it."""


def load_encoder(
    checkpoint: Checkpoint,
    blocks: tuple[int, ...] = (),
    layernorm: bool | None = None,
    input_size: int | None = None,
    precision: Precision = "auto",
) -> Encoder:
    """The encoder; the same object for the same request.

    Raises ValueError where the checkpoint's architecture is not supported, its weights are not complete, or blocks,
    layernorm or input_size are not this encoder's.
    """
    digests = tuple(sorted(checkpoint.digests().items()))
    return _load(checkpoint, digests, Settings(blocks, layernorm, input_size), precision)


@lru_cache(maxsize=2)
def _load(
    checkpoint: Checkpoint, digests: tuple[tuple[str, str], ...], settings: Settings, precision: Precision
) -> Encoder:
    device = "cuda" if torch.cuda.is_available() else "cpu"
    backbone = _family(checkpoint)(checkpoint, settings)
    backbone.network.to(device)
    if precision == "auto":
        precision = "bf16" if backbone.likes_bf16 and fast_at_bf16(device) else "fp32"
    return Encoder(checkpoint.encoder, dict(digests)["weights"], backbone, precision, device)


def fast_at_bf16(device: str) -> bool:
    """Whether the device has instructions for bf16 products."""
    if device == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    capabilities = torch.cpu.get_capabilities() if hasattr(torch.cpu, "get_capabilities") else {}
    return bool(capabilities.get("avx512_bf16") or capabilities.get("amx_bf16"))


def _family(checkpoint: Checkpoint) -> Build:
    if checkpoint.encoder in EMBEDDED:
        return EMBEDDED[checkpoint.encoder]
    model_type = read_json(checkpoint.path / CONFIG).get("model_type")
    if model_type not in FAMILIES:
        raise ValueError(
            f"encoder {checkpoint.encoder}: expected a checkpoint of model_type {', '.join(FAMILIES)}, "
            f"got {model_type} in "
            f"{checkpoint.path}; take one of these"
        )
    return FAMILIES[model_type]
