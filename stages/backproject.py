"""backproject: patch tokens of all views, averaged on the points that each view sees."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import NonNegativeFloat

from b23d.pipeline.stage import stage
from b23d.schemas.features import PointFeatures
from b23d.schemas.params import Params, When
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.views import Views, ViewTokens
from b23d.stages.geometry.cameras import project
from b23d.stages.renderers.visibility import by_depth, by_face, in_frame


class PointVisibility(Params):
    depth_tolerance: NonNegativeFloat = 0.0025
    """How far behind the surface in its pixel a point still counts as on it; unit frame. Surfaces nearer to each other
    than this do not hide each other."""


class BackprojectParams(Params):
    """Which view sees a point, and what it then gives to it."""

    visibility: Literal["point", "face"] = "point"
    """DIFFERENCES.md, row 4. "point": nothing in front of the point itself. "face": its face, or one sharing a corner
    with it, is anywhere in the view, as the released code had it."""
    point: Annotated[PointVisibility, When(visibility="point")] = PointVisibility()
    sample: Literal["nearest", "bilinear"] = "bilinear"
    """DIFFERENCES.md, row 19: the token of the patch a point falls in, or interpolated between the four nearest
    patches' centres."""


@stage(version=1)
def backproject(
    normalize: NormalizedShape, render: Views, extract: ViewTokens, params: BackprojectParams
) -> PointFeatures:
    """Mean over the views that see a point of their tokens at its place; zero, and not `observed`, where no view does.

    Raises ValueError where views and tokens are not equally many.
    """
    if len(render.depth) != len(extract.rows):
        raise ValueError(
            f"tokens: expected those of {len(render.depth)} views, got {len(extract.rows)}; extract them from these "
            "views"
        )
    points = normalize.points.astype(np.float64)
    pixels, depths = project(points, render.world_to_camera, render.intrinsics)
    rows, columns = render.depth.shape[1:]
    if params.visibility == "point":
        seen = by_depth(pixels, depths, render.depth, params.point.depth_tolerance)
    else:
        seen = by_face(render.face_ids, *_faces(normalize)) & in_frame(pixels, depths, rows, columns)
    counts = seen.sum(axis=0, dtype=np.int32)
    grid = extract.rows.shape[1:]
    places = pixels[..., ::-1] * (grid[0] / rows, grid[1] / columns)  # in tokens: (0, 0) is the image's corner
    sums = _sums(seen, places, extract.rows, extract.tokens, params.sample)
    return PointFeatures(
        features=(sums / np.maximum(counts, 1)[:, None]).astype(np.float16),
        counts=counts,
        observed=counts > 0,
        class_token=None if extract.class_tokens is None else extract.class_tokens.mean(axis=0, dtype=np.float32),
        descriptor=extract.encoder,
    )


def _faces(shape: NormalizedShape) -> tuple[np.ndarray, np.ndarray]:
    """What `face_ids` count, as corners (f, k), and which of them each candidate lies on: for a cloud, the points it is
    drawn from, as discs."""
    if shape.kind == "mesh":
        return shape.faces, shape.point_faces
    from scipy.spatial import cKDTree

    from b23d.stages.renderers.discs import drawn_points

    drawn = drawn_points(shape.vertices)
    nearest = cKDTree(shape.vertices[drawn]).query(shape.points)[1]
    return np.arange(len(shape.vertices))[:, None], drawn[nearest]


def _sums(seen: np.ndarray, places: np.ndarray, rows: np.ndarray, tokens: np.ndarray, sample: str) -> np.ndarray:
    """(n, channel) float32: for every point the sum, over the views that see it (view, n), of their tokens at `places`.

    One sparse product: a row per point, a column per token, up to four weights per view that sees the point.
    """
    from scipy.sparse import csr_array

    _, height, width = rows.shape
    point, view = np.nonzero(seen.T)
    place = places[view, point]
    if sample == "nearest":
        corner = np.minimum(np.floor(place), (height - 1, width - 1)).astype(np.int64)
        weights, row, column = np.ones((len(point), 1), np.float32), corner[:, :1], corner[:, 1:]
    else:
        # from the upper left token's centre; beyond the outermost centres the outermost token holds
        place = np.clip(place - 0.5, 0, (height - 1, width - 1))
        corner = np.minimum(np.floor(place), np.maximum((height - 2, width - 2), 0)).astype(np.int64)
        (down, right), (row, column) = (place - corner).T, corner.T
        weights = np.stack([(1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right], axis=1)
        row = np.minimum(row[:, None] + (0, 0, 1, 1), height - 1)
        column = np.minimum(column[:, None] + (0, 1, 0, 1), width - 1)
    indices = rows[view[:, None], row, column]
    starts = np.concatenate([[0], np.cumsum(seen.sum(axis=0) * weights.shape[1])])
    matrix = csr_array(
        (weights.astype(np.float32).ravel(), indices.ravel(), starts), shape=(seen.shape[1], len(tokens))
    )
    sums: np.ndarray = matrix @ tokens.astype(np.float32)
    return sums
