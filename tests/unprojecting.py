"""The inverse of `project`: an oracle for what cameras and renderers say."""

from __future__ import annotations

import numpy as np


def unproject(pixels: np.ndarray, depth: np.ndarray, world_to_camera: np.ndarray, intrinsics: np.ndarray) -> np.ndarray:
    """Points (view, n, 3) of the unit frame at `pixels` (view, n, 2) and `depth` (view, n): the inverse of
    `project`."""
    homogeneous = np.concatenate([pixels, np.ones((*pixels.shape[:-1], 1))], axis=-1)
    camera = homogeneous @ np.linalg.inv(intrinsics).T * depth[..., None]
    return (camera - world_to_camera[:, None, :3, 3]) @ world_to_camera[:, :3, :3]
