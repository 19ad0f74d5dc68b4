"""Which points each view sees: by depth, point by point, or by face as the released code had it."""

from __future__ import annotations

import numpy as np

SLACK = 0.25
"""Pixels by which a surface's slope is forgiven: it is known from differences between neighbouring pixels only."""
STEEPEST = 0.1
"""Difference of inverse depth between neighbouring pixels that is still a slope; above it begins another surface."""


def by_depth(pixels: np.ndarray, depths: np.ndarray, depth_images: np.ndarray, tolerance: float) -> np.ndarray:
    """(view, n) bool: points at `pixels` (view, n, 2) and `depths` (view, n) that nothing in their pixel hides.

    A point is hidden where it lies more than `tolerance` (unit frame, along the camera's z) behind the surface that
    its pixel shows. The surface is continued from the pixel's centre to the point's exact place as a plane, which is
    linear in inverse depth; its slope, along x and along y, is the smaller of the differences to the two neighbours,
    so that it never spans a silhouette. Faces less than `tolerance` apart, coincident ones above all, do not hide each
    other. A point whose pixel shows background is thinner than a pixel there, and seen. Outside of the frame nothing
    is.
    """
    views, rows, columns = depth_images.shape
    inside = in_frame(pixels, depths, rows, columns)
    view, point = np.nonzero(inside)
    x, y = np.moveaxis(pixels[view, point], 1, 0)
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    # one flat, padded image of inverse depths: a neighbour is a constant step away, outside is background (NaN)
    padded = np.full((views, rows + 2, columns + 2), np.nan)
    np.divide(1.0, depth_images, out=padded[:, 1:-1, 1:-1], where=depth_images > 0)
    inverse = padded.ravel()
    at = (view * (rows + 2) + row + 1) * (columns + 2) + column + 1
    centre = inverse[at]
    slope_x, slope_y = _slope(inverse, at, 1), _slope(inverse, at, columns + 2)
    surface = centre + slope_x * (x - column - 0.5) + slope_y * (y - row - 0.5)
    forgiven = tolerance + SLACK * (np.abs(slope_x) + np.abs(slope_y)) / centre**2
    seen = np.zeros(inside.shape, bool)
    seen[view, point] = np.isnan(centre) | (depths[view, point] <= 1 / surface + forgiven)
    return seen


def by_face(face_ids: np.ndarray, faces: np.ndarray, point_faces: np.ndarray) -> np.ndarray:
    """(view, n) bool: points whose face (m, of `faces` (f, k)), or one that shares a corner with it, is anywhere in the
    view.

    The released rule (DIFFERENCES.md, row 4), its slip included: the background's id, -1, is taken for the last face,
    which therefore counts as seen wherever there is background. (Released, the five nearest layers count; here, the
    first.)
    """
    seen = np.zeros((len(face_ids), len(point_faces)), bool)
    for view, ids in enumerate(face_ids):
        shown = np.zeros(len(faces), bool)
        shown[np.unique(ids)] = True  # -1 indexes the last face
        corners = np.zeros(int(faces.max()) + 1, bool)
        corners[faces[shown]] = True
        seen[view] = corners[faces[point_faces]].any(axis=1)
    return seen


def in_frame(pixels: np.ndarray, depths: np.ndarray, rows: int, columns: int) -> np.ndarray:
    """(view, n) bool: points before the camera whose pixel exists."""
    x, y = pixels[..., 0], pixels[..., 1]
    return (depths > 0) & (x >= 0) & (x < columns) & (y >= 0) & (y < rows)


def _slope(inverse: np.ndarray, at: np.ndarray, step: int) -> np.ndarray:
    """Change of inverse depth per pixel, 0 where no neighbour shows the same surface."""
    before, after = inverse[at] - inverse[at - step], inverse[at + step] - inverse[at]
    slope = np.where(np.isnan(before) | (np.abs(after) < np.abs(before)), after, before)
    return np.where(np.abs(slope) < STEEPEST, slope, 0.0)  # NaN compares false
