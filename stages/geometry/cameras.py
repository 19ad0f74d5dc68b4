"""Cameras around a shape, and where its points fall in their pictures. Convention: `schemas/views.py` (OpenCV's).

Angles are in radians unless a name says degrees. Azimuth 0 lies on +z and grows towards +x (counter-clockwise seen
from above); elevation π/2 is above (+y). All arrays are float64.
"""

from __future__ import annotations

import numpy as np

CLEARANCE = 0.05
"""Least depth, unit frame, that a surface keeps from a camera: nothing is ever cut by a near plane."""


def ring_angles(rings: int) -> np.ndarray:
    """Top, `rings` equi-angular rings of 2(rings + 1) viewpoints each from above to below, bottom.

    Returns (2 rings (rings + 1) + 2, 2) azimuth and elevation. "n equidistant horizontal slices … 2(n + 1) viewpoints
    equiangular on the circumference of each slice, as well as one view from the top and one from the bottom" (Back to
    3D, Sec. 4.1); with n = 5 neighbours are 30° apart along a ring and between rings.
    """
    per_ring = 2 * (rings + 1)
    elevation = np.pi / 2 - np.pi * np.arange(1, rings + 1) / (rings + 1)
    azimuth = 2 * np.pi * np.arange(per_ring) / per_ring
    grid = np.stack(np.meshgrid(azimuth, elevation), axis=-1).reshape(-1, 2)
    return np.concatenate([[[0.0, np.pi / 2]], grid, [[0.0, -np.pi / 2]]])


def fibonacci_angles(count: int) -> np.ndarray:
    """`count` viewpoints of nearly equal spacing, on a Fibonacci spiral from above to below; (count, 2), as above.

    Swinbank and Purser, Fibonacci grids: a novel approach to global modelling, 2006.
    """
    i = np.arange(count)
    golden = (1 + np.sqrt(5)) / 2
    return np.stack([2 * np.pi * (i / golden % 1), np.arcsin(1 - (2 * i + 1) / count)], axis=1)


def rotations(angles: np.ndarray) -> np.ndarray:
    """World-to-camera rotations (view, 3, 3) of cameras at `angles` (view, 2) that look at the origin.

    A camera's up vector is the meridian's tangent towards the top, so at top and bottom, too, it is well defined: it
    is the limit along the meridian of the given azimuth.
    """
    azimuth, elevation = angles[:, 0], angles[:, 1]
    sin_a, cos_a, sin_e, cos_e = np.sin(azimuth), np.cos(azimuth), np.sin(elevation), np.cos(elevation)
    right = np.stack([cos_a, np.zeros_like(cos_a), -sin_a], axis=1)
    up = np.stack([-sin_e * sin_a, cos_e, -sin_e * cos_a], axis=1)
    back = np.stack([cos_e * sin_a, sin_e, cos_e * cos_a], axis=1)
    return np.stack([right, -up, -back], axis=1)


def look_at_origin(angles: np.ndarray, distance: float) -> np.ndarray:
    """World-to-camera transforms (view, 4, 4) of cameras at `angles` (view, 2), `distance` from the origin."""
    world_to_camera = np.tile(np.eye(4), (len(angles), 1, 1))
    world_to_camera[:, :3, :3] = rotations(angles)
    world_to_camera[:, 2, 3] = distance
    return world_to_camera


def pinhole(resolution: int, field_of_view: float) -> np.ndarray:
    """Intrinsics (3, 3), in pixels, of a square picture; `field_of_view` is its full angle in degrees, side to side."""
    focal = resolution / 2 / np.tan(np.deg2rad(field_of_view) / 2)
    return np.array([[focal, 0, resolution / 2], [0, focal, resolution / 2], [0, 0, 1]])


def fitting_distance(points: np.ndarray, angles: np.ndarray, field_of_view: float, margin: float) -> float:
    """Least distance at which cameras at `angles` all have all `points` (n, 3) in the frame; one for all views.

    `margin` is the share of the picture's half side kept free at every edge, in [0, 1). A point r (rotated) is in the
    frame at distance d where |x| ≤ k (z + d), |y| ≤ k (z + d) with k = (1 - margin) tan(fov / 2), so d is the largest
    of
    |x| / k - z and |y| / k - z over points and views; and no point comes nearer than `CLEARANCE`.
    """
    k = (1 - margin) * np.tan(np.deg2rad(field_of_view) / 2)
    bounds = np.array([[1 / k, 0, -1], [-1 / k, 0, -1], [0, 1 / k, -1], [0, -1 / k, -1], [0, 0, -1]])
    limits = np.array([0, 0, 0, 0, CLEARANCE])
    transposed = np.asarray(points, np.float64).T
    return max(float(((bounds @ rotation @ transposed).max(axis=1) + limits).max()) for rotation in rotations(angles))


def project(points: np.ndarray, world_to_camera: np.ndarray, intrinsics: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pixels (view, n, 2) as (x, y), and depths (view, n), of `points` (n, 3) or (view, n, 3) of the unit frame.

    A point at or behind the camera's plane has depth ≤ 0 and no meaningful pixel (it may be infinite or NaN).
    """
    camera = points @ np.swapaxes(world_to_camera[:, :3, :3], 1, 2) + world_to_camera[:, None, :3, 3]
    depth = camera[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = (camera @ intrinsics.T)[..., :2] / depth[..., None]
    return pixels, depth


def pixel_rays(intrinsics: np.ndarray, resolution: int) -> np.ndarray:
    """Camera-frame rays (row, column, 3) through the pixels' centres, with z = 1: depth times ray is the point seen."""
    centres = np.arange(resolution) + 0.5
    x, y = np.meshgrid(centres, centres)
    return np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(intrinsics).T
