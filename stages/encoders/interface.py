"""What every encoder is: name, weights' digest, input size, patch grid, channels, class token; images in, tokens
out."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

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

    def prepare(self, images: Tensor) -> Tensor:
        """uint8 (b, h, w, 3) on the CPU → float32 (b, 3, size, size), channels last in memory.

        Resizing is antialiased and in whole levels, as PIL's.
        """
        x = images.permute(0, 3, 1, 2)
        if x.shape[-2:] != (self.size, self.size):
            x = functional.interpolate(
                x, (self.size, self.size), mode=self.resample, antialias=self.resample != "nearest-exact"
            )
        mean, std = (torch.tensor(values).view(3, 1, 1) for values in (self.mean, self.std))
        return ((x - mean) / std).contiguous(memory_format=torch.channels_last)


@dataclass(frozen=True)
class Backbone:
    """What a family gives: a network whose `forward(pixels (b, 3, s, s))` is `(tokens (b, i, j, channel), class (b,
    channel) | None)`."""

    network: nn.Module
    pixels: Pixels
    grid: tuple[int, int]
    """Patch rows and columns."""
    channels: int
    class_token: bool
    likes_bf16: bool
    """Whether bf16 autocast is both faster and near enough; True for transformers."""
    batch: int
    """Views at a time on a CPU; small batches stay in the cache."""


CUDA_BATCH = 8
"""On a CUDA device, this many times `Backbone.batch`."""


@dataclass(frozen=True)
class Encoder:
    """A frozen encoder, ready on its device."""

    name: str
    weights: str
    """sha256 of the weights."""
    backbone: Backbone
    precision: Literal["bf16", "fp32"]
    device: str

    @property
    def input_size(self) -> int:
        return self.backbone.pixels.size

    @property
    def grid(self) -> tuple[int, int]:
        return self.backbone.grid

    @property
    def channels(self) -> int:
        return self.backbone.channels

    @property
    def class_token(self) -> bool:
        return self.backbone.class_token

    def encode(self, images: np.ndarray, batch: int | None = None) -> tuple[np.ndarray, np.ndarray | None]:
        """Encode sRGB images, uint8 (view, h, w, 3), `batch` at a time (None: as suits the device).

        Returns tokens, float16 (view, i, j, channel), the grid covering the whole image, and class tokens, float16
        (view, channel), or None. Raises ValueError for other images, and where a value exceeds float16's range.
        """
        if images.dtype != np.uint8 or images.ndim != 4 or images.shape[-1] != 3 or 0 in images.shape:
            raise ValueError(
                f"encoder {self.name}: expected images uint8 (view, row, column, 3), "
                f"got {images.dtype} {images.shape}; "
                "convert them"
            )
        views, step = len(images), batch or self.backbone.batch * (CUDA_BATCH if self.device == "cuda" else 1)
        tokens = np.empty((views, *self.grid, self.channels), np.float16)
        classes = np.empty((views, self.channels), np.float16) if self.class_token else None
        with torch.inference_mode(), self._arithmetic():
            for start in range(0, views, step):
                part = slice(start, start + step)
                pixels = self.backbone.pixels.prepare(torch.tensor(images[part]))
                patch, first = self.backbone.network(pixels.to(self.device))
                tokens[part] = self._half(patch)
                if classes is not None:
                    classes[part] = self._half(first)
        return tokens, classes

    def _half(self, values: Tensor) -> np.ndarray:
        half = values.to(torch.float16)
        if not bool(half.isfinite().all()):
            raise ValueError(
                f"encoder {self.name}: expected tokens in float16's range (65504), "
                f"got {float(values.abs().max()):.3g}; "
                "set stages.extract.layernorm, or take other blocks or weights"
            )
        return half.cpu().numpy()

    def _arithmetic(self) -> AbstractContextManager[object]:
        if self.precision == "bf16":
            return torch.autocast(self.device, torch.bfloat16)
        # On CUDA, fp32 means fp32: convolutions would otherwise round their inputs to TF32.
        return torch.backends.cudnn.flags(enabled=True, allow_tf32=False) if self.device == "cuda" else nullcontext()


def blocks_taken(encoder: str, wanted: tuple[int, ...], depth: int, default: int) -> tuple[int, ...]:
    """The blocks to take. Raises ValueError where one is beyond the encoder's depth."""
    if wanted and max(wanted) >= depth:
        raise ValueError(
            f"encoder {encoder}: expected blocks from 0 to {depth - 1}, got {list(wanted)}; "
            "correct stages.extract.blocks"
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
    """Feature maps (b, channel, i, j) of one grid → tokens (b, i, j, channels of all). Raises ValueError where grids
    differ."""
    grids = {tuple(one.shape[-2:]) for one in maps}
    if len(grids) > 1:
        raise ValueError(
            f"encoder {encoder}: expected stages.extract.blocks of one grid, got {sorted(grids)}; "
            "take blocks of one stride"
        )
    return torch.cat(maps, 1).permute(0, 2, 3, 1)
