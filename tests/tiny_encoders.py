"""Encoders of tiny random weights, the embedded ones with their own, and pictures for them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from b23d.stages.encoders.encoder import Encoder
from b23d.stages.encoders.interface import Pixels
from b23d.stages.encoders.load import load_encoder
from b23d.stages.encoders.weights import find_checkpoint
from tests.tiny_checkpoints import TINY

EMBEDDED = ["efficientnet-lite0", "saliency-vit-s14"]


def tiny(
    folders: dict[str, Path],
    family: str,
    blocks: tuple[int, ...] = (),
    layernorm: bool | None = None,
    input_size: int | None = None,
) -> Encoder:
    own_size_only = family in ("clip", "sam", "siglip", "siglip2", "efficientnet")
    size = input_size or (None if own_size_only else TINY[family].size)
    return load_encoder(find_checkpoint(f"test/{family}", folders[family]), blocks, layernorm, size, "fp32")


def embedded(name: str, **options: object) -> Encoder:
    try:
        checkpoint = find_checkpoint(name)
    except FileNotFoundError as error:
        pytest.skip(str(error))
    return load_encoder(checkpoint, **options)  # type: ignore[arg-type]


def images(count: int, size: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (count, size, size, 3), dtype=np.uint8)


def grids(encoder: Encoder, views: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """Tokens of all patches, (view, i, j, channel), and class tokens."""
    tokens, classes = encoder.encode(views)
    return tokens.reshape(len(views), *encoder.grid, encoder.channels), classes


def prepared(pixels: Pixels, views: np.ndarray) -> torch.Tensor:
    return pixels.normalized(pixels.resized(torch.from_numpy(views)))


def close(got: np.ndarray, expected: torch.Tensor, tolerance: float = 2e-3) -> None:
    """float16 against float32: relative to the largest value."""
    assert got.shape == expected.shape
    np.testing.assert_allclose(
        got.astype(np.float32), expected.numpy(), atol=tolerance * float(expected.abs().max()), rtol=0
    )


def cosines(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    a, b = a.astype(np.float64), b.astype(np.float64)
    return np.asarray((a * b).sum(-1) / np.linalg.norm(a, axis=-1) / np.linalg.norm(b, axis=-1))


def scene() -> np.ndarray:
    """An envelope on a table, and a ball: two things an ImageNet network knows."""
    y, x = np.mgrid[:224, :224] + 0.5
    envelope, ball = np.full((224, 224, 3), (200, 160, 120), np.uint8), np.full((224, 224, 3), 255, np.uint8)
    envelope[50:174, 20:204] = 245
    flap = (np.abs((y - 50) - 0.7 * np.minimum(x - 20, 204 - x)) < 1.5) & (y < 120) & (x > 20) & (x < 204)
    envelope[flap] = 120
    ball[(y - 112) ** 2 + (x - 112) ** 2 < 80**2] = (240, 130, 20)
    return np.stack([envelope, ball])
