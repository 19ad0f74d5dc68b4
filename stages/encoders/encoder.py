"""A frozen encoder on its device: images in, tokens out."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from b23d.stages.encoders.interface import Backbone


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

    @property
    def whole(self) -> bool:
        """Whether the network has to see every patch of a view."""
        return self.backbone.whole

    def encode(
        self, images: np.ndarray, patches: np.ndarray | None = None, batch: int | None = None
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """Encode sRGB images, uint8 (view, h, w, 3).

        Args:
            images: of any size; the patch grid covers them whole.
            patches: (view, i, j) bool, those to encode, at least one a view; None: all. The others do not exist for a
                network that is not `whole`; a whole one sees them all, and their tokens are left out afterwards.
            batch: whole views' worth of patches at a time. None: as suits the device; halved where its memory ends.

        Returns tokens, float16 (m, channel), in the order of `np.nonzero(patches)`, and class tokens, float16 (view,
        channel), or None. How many go through at once changes nothing beyond rounding. Raises ValueError for other
        images or patches, and where a value exceeds float16's range.
        """
        views = len(images)
        if images.dtype != np.uint8 or images.ndim != 4 or images.shape[-1] != 3 or 0 in images.shape:
            raise ValueError(
                f"encoder {self.name}: expected images uint8 (view, row, column, 3), got {images.dtype} "
                f"{images.shape}; convert them"
            )
        if patches is None:
            patches = np.ones((views, *self.grid), bool)
        if patches.shape != (views, *self.grid) or not patches.any(axis=(1, 2)).all():
            raise ValueError(
                f"encoder {self.name}: expected patches bool {(views, *self.grid)} with at least one in every view, "
                f"got {patches.dtype} {patches.shape} with {patches.sum()}; give the patches of these images"
            )
        patches = patches.reshape(views, -1)
        counts = patches.sum(axis=1)
        budget = (batch or self.backbone.batch) * patches.shape[1]
        if batch is None and self.device == "cuda":
            budget = patches.size  # the whole shape at once, if the card's memory holds it
        tokens: list[Tensor] = [torch.empty(0)] * views
        classes: list[Tensor] = [torch.empty(0)] * views
        with torch.inference_mode(), self._arithmetic():
            for chosen, kept in self._groups(patches):
                for part, rows, first in self._passes(images, chosen, kept, budget):
                    for view, row in zip(part, rows, strict=True):
                        tokens[view] = row[: counts[view]]
                    if first is not None:
                        for view, row in zip(part, first, strict=True):
                            classes[view] = row
            # only here does the host wait for the device
            return self._half(torch.cat(tokens)), self._half(torch.stack(classes)) if self.class_token else None

    def _groups(self, patches: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray | None]]:
        """Views that go through together, those with the most patches first, and their patches as `Backbone` has them.

        On a CPU a transformer has views with equally many, without padding. A card has all of them: it would wait for
        the host at every one of these small groups (ViT-S, a shape's 62 views, H200: 159 ms in groups, 11 ms at once).
        """
        counts = patches.sum(axis=1)
        if self.whole or self.device == "cuda":
            groups = [np.argsort(-counts, kind="stable")]
        else:
            groups = [np.flatnonzero(counts == count) for count in np.unique(counts)]
        for chosen in groups:
            yield chosen, None if patches[chosen].all() else _padded(patches[chosen])

    def _passes(
        self, images: np.ndarray, chosen: np.ndarray, kept: np.ndarray | None, budget: int
    ) -> Iterator[tuple[np.ndarray, Tensor, Tensor | None]]:
        """Tokens (b, n, channel) and class tokens (b, channel) of as many of the `chosen` views as go at a time."""
        grid = self.grid[0] * self.grid[1]
        most, start = budget, 0
        while start < len(chosen):
            widest = grid if kept is None or self.whole else int((kept[start] >= 0).sum())
            part = chosen[start : start + max(most // widest, 1)]
            places = None if kept is None else self._sent(torch.from_numpy(kept[start : start + len(part), :widest]))
            try:
                rows, first = self._forward(images[part], places)
            except torch.OutOfMemoryError:
                if len(part) == 1:
                    raise
                most = len(part) // 2 * widest
                continue
            yield part, rows, first
            start += len(part)

    def _forward(self, images: np.ndarray, kept: Tensor | None) -> tuple[Tensor, Tensor | None]:
        dtype = torch.bfloat16 if self.precision == "bf16" else torch.float32
        pixels = self.backbone.pixels.normalized(self._sent(self.backbone.pixels.resized(torch.tensor(images)))).to(
            dtype
        )
        tokens, first = self.backbone.network(pixels, None if self.whole else kept)
        if self.whole and kept is not None:
            tokens = tokens.gather(1, kept.clamp(min=0)[..., None].expand(-1, -1, tokens.shape[-1]))
        return tokens, first

    def _sent(self, values: Tensor) -> Tensor:
        """On the device; to a card the copy runs while the host goes on."""
        return values.pin_memory().to(self.device, non_blocking=True) if self.device == "cuda" else values

    def _half(self, values: Tensor) -> np.ndarray:
        half = values.to(torch.float16)
        # a half is infinite or none where its exponent's bits are all set; integers are compared faster
        if bool(((half.view(torch.int16) & 0x7C00) == 0x7C00).any()):
            raise ValueError(
                f"encoder {self.name}: expected tokens in float16's range (65504), got "
                f"{float(values.abs().max()):.3g}; set stages.extract.layernorm, or take other blocks or weights"
            )
        return half.cpu().numpy()

    def _arithmetic(self) -> AbstractContextManager[object]:
        # On CUDA, fp32 means fp32: convolutions would otherwise round their inputs to TF32.
        fp32 = self.device == "cuda" and self.precision == "fp32"
        return torch.backends.cudnn.flags(enabled=True, allow_tf32=False) if fp32 else nullcontext()


def _padded(patches: np.ndarray) -> np.ndarray:
    """bool (b, patch) → int64 (b, n): which patches of each view, ascending, and -1 where it has fewer than another."""
    counts = patches.sum(axis=1, keepdims=True)
    first = np.argsort(~patches, axis=1, kind="stable")[:, : counts.max()]
    return np.where(np.arange(first.shape[1]) < counts, first, -1)
