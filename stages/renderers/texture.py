"""Texture lookup without aliasing: bilinear within the level of an image pyramid that fits the texture's size on
screen."""

from __future__ import annotations

import numpy as np


class Texture:
    """A texture (h, w, 3) uint8 that repeats in both directions, as a pyramid of halved levels."""

    def __init__(self, image: np.ndarray) -> None:
        self.levels = [image.astype(np.float32) / 255]
        while max(self.levels[-1].shape[:2]) > 1:
            self.levels.append(_halve(self.levels[-1]))

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in texels."""
        return self.levels[0].shape[1], self.levels[0].shape[0]

    def sample(self, uvs: np.ndarray, scale: np.ndarray) -> np.ndarray:
        """Colours (p, 3) in [0, 1] at `uvs` (p, 2), origin at the lower left, each pixel `scale` (p,) texels wide."""
        level = np.clip(np.rint(np.log2(np.maximum(scale, 1))), 0, len(self.levels) - 1).astype(int)
        colors = np.empty((len(uvs), 3), np.float32)
        for index in np.unique(level):
            chosen = level == index
            colors[chosen] = _bilinear(self.levels[index], uvs[chosen])
        return colors


def texels_per_pixel(corners: np.ndarray, uvs: np.ndarray, size: tuple[int, int], intrinsics: np.ndarray) -> np.ndarray:
    """Texels per pixel (p,), along a side, of triangles with camera coordinates `corners` (p, 3, 3) and `uvs` (p, 3,
    2)."""
    pixels = corners[..., :2] / corners[..., 2:] * (intrinsics[0, 0], intrinsics[1, 1])
    return np.sqrt(_area(uvs * size) / np.maximum(_area(pixels), 1e-12))


def _area(triangles: np.ndarray) -> np.ndarray:
    u, v = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    return np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]) / 2


def _halve(image: np.ndarray) -> np.ndarray:
    """Means of 2 × 2 texels; an odd last row or column counts twice."""
    image = np.pad(image, ((0, image.shape[0] % 2), (0, image.shape[1] % 2), (0, 0)), mode="edge")
    height, width = image.shape[:2]
    return image.reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3))


def _bilinear(image: np.ndarray, uvs: np.ndarray) -> np.ndarray:
    height, width = image.shape[:2]
    x, y = uvs[:, 0] * width - 0.5, (1 - uvs[:, 1]) * height - 0.5
    left, top = np.floor(x), np.floor(y)
    right_share, lower_share = (x - left)[:, None], (y - top)[:, None]
    columns = (left.astype(int)[:, None] + (0, 1)) % width
    rows = (top.astype(int)[:, None] + (0, 1)) % height
    upper = image[rows[:, 0], columns[:, 0]] * (1 - right_share) + image[rows[:, 0], columns[:, 1]] * right_share
    lower = image[rows[:, 1], columns[:, 0]] * (1 - right_share) + image[rows[:, 1], columns[:, 1]] * right_share
    return upper * (1 - lower_share) + lower * lower_share
