"""backproject: patch tokens of all views, averaged at the candidate points that each view sees (paper, Sec. 3.1)."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from pipeline.stage import stage
from schemas.features import PointFeatures
from schemas.params import Params
from schemas.shape import NormalizedShape
from schemas.views import Views, ViewTokens


class BackprojectParams(Params):
    visibility: Literal["point", "face"] = "point"
    """`point`: first hit, by a depth test at the point itself. `face`: the released code's rule in spirit: a point is visible
    where its face, or one that shares a vertex with it, is seen; the background's index -1 wraps to the last face."""
    depth_tolerance: float = Field(0.01, ge=0)
    """Unit-frame length by which a point may lie behind the surface that a view shows there, and still be seen. The surface's
    depth is the largest of the four pixels around the point, so that a slanted surface does not hide itself."""
    sample: Literal["nearest", "bilinear"] = "bilinear"
    """How a view's patch tokens are read at a point's pixel."""


@stage(version=1)
def backproject(normalize: NormalizedShape, render: Views, extract: ViewTokens, params: BackprojectParams) -> PointFeatures:
    """Mean over the views that see a point of the token at its pixel; the sum is `features * counts`.

    Points that no view sees get zeros and `observed` False. The class token is the mean over all views.
    """
    from stages.geometry.cameras import project

    points = normalize.points.astype(np.float64)
    pixels, depths = project(points, render.world_to_camera, render.intrinsics)
    if params.visibility == "face":
        visible = _seen_by_face(normalize, render.face_ids)
    else:
        visible = _seen_by_depth(pixels, depths, render.depth, params.depth_tolerance)
    rows, columns = render.depth.shape[1:]
    visible &= _in_frame(pixels, depths, rows, columns)
    counts = visible.sum(axis=0).astype(np.int32)
    sums = _sample(extract.tokens, pixels / (columns, rows), visible, params.sample)
    class_token = None if extract.class_tokens is None else extract.class_tokens.astype(np.float32).mean(axis=0)
    return PointFeatures(
        features=(sums / np.maximum(counts, 1)[:, None]).astype(np.float16),
        counts=counts,
        observed=counts > 0,
        class_token=class_token,
        descriptor=extract.encoder,
    )


def _in_frame(pixels: np.ndarray, depths: np.ndarray, rows: int, columns: int) -> np.ndarray:
    x, y = pixels[..., 0], pixels[..., 1]
    return np.asarray((depths > 0) & (x >= 0) & (x < columns) & (y >= 0) & (y < rows))


def _seen_by_depth(pixels: np.ndarray, depths: np.ndarray, depth: np.ndarray, tolerance: float) -> np.ndarray:
    """(view, n): no surface lies in front of the point by more than the tolerance."""
    views, rows, columns = depth.shape
    corner = np.floor(np.nan_to_num(pixels) - 0.5).astype(int)   # pixel centres are at halves
    view = np.arange(views)[:, None]
    surface = np.zeros_like(depths)
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        x, y = (corner[..., 0] + dx).clip(0, columns - 1), (corner[..., 1] + dy).clip(0, rows - 1)
        surface = np.maximum(surface, depth[view, y, x])
    return np.asarray((surface > 0) & (depths <= surface + tolerance))


def _seen_by_face(shape: NormalizedShape, face_ids: np.ndarray) -> np.ndarray:
    """(view, n): the point's face, or one sharing a vertex with it, is among the seen ones; -1 wraps (method note, row 4)."""
    if shape.kind == "cloud":   # a disc's id is its point's: the candidate's own, or its nearest
        from scipy.spatial import cKDTree

        nearest = cKDTree(shape.vertices).query(shape.points)[1]
        drawn = np.zeros((len(face_ids), len(shape.vertices)), bool)
        for view, ids in enumerate(face_ids):
            drawn[view, np.unique(ids)] = True
        return drawn[:, nearest]
    faces = shape.faces
    visible = np.empty((len(face_ids), len(shape.points)), bool)
    for view, ids in enumerate(face_ids):
        touched = np.zeros(len(shape.vertices), bool)
        touched[faces[np.unique(ids)]] = True
        visible[view] = touched[faces].any(axis=1)[shape.point_faces]
    return visible


def _sample(tokens: np.ndarray, places: np.ndarray, visible: np.ndarray, how: Literal["nearest", "bilinear"]) -> np.ndarray:
    """Sums (n, channel) over views of the tokens (view, i, j, channel) at `places` (view, n, 2; 0 … 1 across the image).

    One sparse matrix does it: a row per point, a column per token, the interpolation weights as entries.
    """
    from scipy.sparse import csr_array

    views, height, width, channels = tokens.shape
    view, point = np.nonzero(visible)
    at = places[view, point] * (width, height) - 0.5   # tokens are centred at halves of the grid
    if how == "nearest":
        at = np.round(at)
    low = np.floor(at)
    part = at - low
    entries = []
    for dx in (0, 1):
        for dy in (0, 1):
            x = (low[:, 0] + dx).clip(0, width - 1).astype(np.int64)
            y = (low[:, 1] + dy).clip(0, height - 1).astype(np.int64)
            weight = (part[:, 0] if dx else 1 - part[:, 0]) * (part[:, 1] if dy else 1 - part[:, 1])
            entries.append((weight, point, (view * height + y) * width + x))
    weights, rows, columns = (np.concatenate(parts) for parts in zip(*entries, strict=True))
    matrix = csr_array((weights.astype(np.float32), (rows, columns)), shape=(places.shape[1], views * height * width))
    return np.asarray(matrix @ tokens.reshape(-1, channels).astype(np.float32))
