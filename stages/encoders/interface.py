"""What a family of encoders gives: a network, how images become its input, and what is checked of what is wanted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor, nn
from torch.nn import functional

from b23d.stages.encoders.weights import Checkpoint

Resample = Literal["nearest-exact", "bilinear", "bicubic"]
Triple = tuple[float, float, float]


@dataclass(frozen=True)
class Settings:
    """What of an encoder is wanted; `ExtractParams` explains each."""

    blocks: tuple[int, ...] = ()
    layernorm: bool | None = None
    input_size: int | None = None


@dataclass(frozen=True)
class Pixels:
    """How images become the network's input: resized to a square, then `(level - mean) / std`, with levels in 0 …
    255."""

    size: int
    mean: Triple
    std: Triple
    resample: Resample = "bicubic"

    def resized(self, images: Tensor) -> Tensor:
        """uint8 (b, h, w, 3) on the CPU → uint8 (b, 3, size, size): antialiased and in whole levels, as PIL's."""
        x = images.permute(0, 3, 1, 2)
        if x.shape[-2:] == (self.size, self.size):
            return x
        return functional.interpolate(
            x, (self.size, self.size), mode=self.resample, antialias=self.resample != "nearest-exact"
        )

    def normalized(self, levels: Tensor) -> Tensor:
        """uint8 (b, 3, size, size) → float32 on the same device, channels last in memory."""
        mean, std = (torch.tensor(values, device=levels.device).view(3, 1, 1) for values in (self.mean, self.std))
        return (levels - mean.float()).div_(std).contiguous(memory_format=torch.channels_last)


@dataclass(frozen=True)
class Backbone:
    """A network whose `forward(pixels (b, 3, s, s), kept)` is `(tokens (b, n, channel), class (b, channel) | None)`.

    `kept`: int64 (b, n), which patches of each view exist, counted row by row and ascending; None: all of them. Tokens
    are theirs, in that order. A view with fewer than another has -1 after its own: no token sees these places, and
    what comes out there means nothing.
    """

    network: nn.Module
    pixels: Pixels
    grid: tuple[int, int]
    """Patch rows and columns."""
    channels: int
    class_token: bool
    likes_bf16: bool
    """Whether bf16 is both faster and near enough; True for transformers."""
    batch: int
    """Views at a time on a CPU; small batches stay in the cache."""
    whole: bool = False
    """The network is only ever given `kept=None`: convolutions and windowed attention need the whole picture."""


Build = Callable[[Checkpoint, Settings], Backbone]
"""What every family's file has, under the name `build`."""


def blocks_taken(encoder: str, wanted: tuple[int, ...], depth: int, default: int) -> tuple[int, ...]:
    """The blocks to take. Raises ValueError where one is beyond the encoder's depth."""
    if wanted and max(wanted) >= depth:
        raise ValueError(
            f"encoder {encoder}: expected blocks from 0 to {depth - 1}, got {list(wanted)}; correct "
            "stages.extract.blocks"
        )
    return wanted or (default,)


def size_taken(encoder: str, wanted: int | None, own: int, patch: int) -> int:
    """The input size. Raises ValueError where it is not a multiple of the patch."""
    size = wanted or own
    if size % patch:
        raise ValueError(
            f"encoder {encoder}: expected stages.extract.input_size a multiple of its patch, {patch}, got {size}; "
            f"take {max(size // patch, 1) * patch}"
        )
    return size


def no_layernorm(encoder: str, wanted: bool | None) -> None:
    """Raises ValueError where a layer norm is asked of an encoder that has none."""
    if wanted:
        raise ValueError(
            f"encoder {encoder}: expected no stages.extract.layernorm (it has no final layer norm), got true; remove it"
        )


def joined(encoder: str, maps: list[Tensor]) -> Tensor:
    """Feature maps (b, channel, i, j) as one (b, channels of all, i, j). Raises ValueError where grids differ."""
    grids = {tuple(one.shape[-2:]) for one in maps}
    if len(grids) > 1:
        raise ValueError(
            f"encoder {encoder}: expected stages.extract.blocks of one grid, got {sorted(grids)}; take blocks of one "
            "stride"
        )
    return torch.cat(maps, 1)


def tokens_of(maps: Tensor) -> Tensor:
    """A feature map (b, channel, i, j) as tokens (b, i * j, channel)."""
    return maps.flatten(2).transpose(1, 2)
