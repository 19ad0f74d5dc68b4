"""From a checkpoint and what is wanted of it to an encoder on its device; loaded once a process."""

from __future__ import annotations

from functools import lru_cache
from importlib import import_module
from typing import Literal

import torch

from b23d.stages.encoders import names
from b23d.stages.encoders.encoder import Encoder
from b23d.stages.encoders.interface import Build, Settings
from b23d.stages.encoders.names import family_of, packaged
from b23d.stages.encoders.weights import CONFIG, Checkpoint, read_json

Precision = Literal["auto", "bf16", "fp32"]


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
    backbone = _builder(checkpoint)(checkpoint, settings)
    if precision == "auto":
        precision = "bf16" if backbone.likes_bf16 and fast_at_bf16(device) else "fp32"
    backbone.network.to(device, torch.bfloat16 if precision == "bf16" else torch.float32)
    return Encoder(checkpoint.encoder, dict(digests)["weights"], backbone, precision, device)


def fast_at_bf16(device: str) -> bool:
    """Whether the device has instructions for bf16 products."""
    if device == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    capabilities = torch.cpu.get_capabilities() if hasattr(torch.cpu, "get_capabilities") else {}
    return bool(capabilities.get("avx512_bf16") or capabilities.get("amx_bf16"))


def _builder(checkpoint: Checkpoint) -> Build:
    """`build` of the family's file, which is imported only now. A folder's config.json tells its family."""
    family = family_of(checkpoint.encoder)
    if packaged(checkpoint.encoder) is None:
        model_type = read_json(checkpoint.path / CONFIG).get("model_type")
        family = next((one for one in names.FAMILIES if model_type in one.model_type), None)
        if family is None:
            known = ", ".join(name for one in names.FAMILIES for name in one.model_type)
            raise ValueError(
                f"encoder {checkpoint.encoder}: expected a checkpoint of model_type {known}, got {model_type} in "
                f"{checkpoint.path}; take one of these"
            )
    assert family is not None
    build: Build = import_module(f"b23d.stages.encoders.{family.module}").build
    return build
