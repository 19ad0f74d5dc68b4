"""What `b23d show` draws in a terminal beside an artifact's tables: small pictures in half blocks, two pixels a
character."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from b23d.pipeline.run import Run
from b23d.schemas.artifact import Artifact
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.predictions import Prediction
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.views import Views, ViewTokens

if TYPE_CHECKING:
    from rich.console import RenderableType

TILE = 28  # pixels of a view: characters across, and half as many lines
SHAPE = 52


def thumbnail(run: Run, shape: str, artifact: Artifact, width: int) -> RenderableType | None:
    """Pictures of an artifact side by side in `width` characters; None for what has none (scores, labels).

    Views: some of them, their depth below. Tokens: some views in PCA colours. Features: PCA colours, and how many views
    see each point. Distances: from candidate 0. Predictions: discs, and annotated keypoints as rings.
    """
    from PIL import Image
    from rich_pixels import Pixels

    if isinstance(artifact, Views):
        chosen = _spread(len(artifact.images), width // TILE)
        rows = [_row(artifact.images[chosen]), _row(np.stack([_depth(artifact.depth[i]) for i in chosen]))]
    elif isinstance(artifact, ViewTokens):
        rows = [_row(token_colors(artifact, _spread(len(artifact.rows), width // TILE)))]
    else:
        rows = (
            [np.concatenate(shown, axis=1)]
            if (shown := _shapes(run, shape, artifact)[: max(1, width // SHAPE)])
            else []
        )
    return Pixels.from_image(Image.fromarray(np.concatenate(rows))) if rows else None


def token_colors(tokens: ViewTokens, views: Any = slice(None)) -> np.ndarray:
    """Some views' tokens in the colours of their first three principal components, (view, i, j, 3) uint8; white where a
    patch has none of its own."""
    from b23d.stages.workbench.pictures.principal import fit_basis

    kept = tokens.kept[views]
    own = tokens.grid(views)[kept]
    basis = fit_basis([own])
    colors = np.full((*kept.shape, 3), 255, np.uint8)
    colors[kept] = basis.colors(basis.project(own))
    return colors


def distance_colors(distances: GeodesicDistances) -> np.ndarray:
    """(n, 3) uint8: each candidate's distance from candidate 0, over the largest; unreachable ones as the largest."""
    from b23d.stages.workbench.pictures.coloring import plasma

    away = distances.distances[0].astype(np.float32)
    largest = float(away[np.isfinite(away)].max(initial=0.0)) or 1.0
    return plasma(np.where(np.isfinite(away), away / largest, 1.0))


def _shapes(run: Run, shape: str, artifact: Artifact) -> list[np.ndarray]:
    """Pictures (SHAPE, SHAPE, 4) uint8 of the shape, coloured by what the artifact says of its candidates."""
    from b23d.stages.workbench.pictures.coloring import feature_colors, plasma
    from b23d.stages.workbench.pictures.painting import marks, picture
    from b23d.stages.workbench.pictures.principal import fit_basis
    from b23d.stages.workbench.results.gathering import Gathering

    if isinstance(artifact, NormalizedShape):
        return [picture(artifact, None, SHAPE)]
    if not isinstance(artifact, PointFeatures | GeodesicDistances | Prediction):
        return []
    base = run.artifact(shape, "normalize")
    assert isinstance(base, NormalizedShape)
    if isinstance(artifact, Prediction):
        entry = Gathering(run).entry(next(item for item in run.shapes if item.name == shape))
        return [picture(base, None, SHAPE, marks(entry, artifact))]
    if isinstance(artifact, GeodesicDistances):
        return [picture(base, distance_colors(artifact), SHAPE)]
    counts = plasma(artifact.counts / max(int(artifact.counts.max(initial=0)), 1))
    return [
        picture(base, feature_colors(artifact, fit_basis([artifact.features])), SHAPE),
        picture(base, counts, SHAPE),
    ]


def _spread(count: int, most: int) -> list[int]:
    """At most `most` indices, evenly over `count`; at least one."""
    return [int(i) for i in np.linspace(0, count - 1, max(1, min(count, most))).round()]


def _row(images: np.ndarray) -> np.ndarray:
    """Images (k, row, column, 3) uint8 side by side, TILE pixels each: (TILE, k TILE, 3)."""
    from PIL import Image

    return np.concatenate([np.asarray(Image.fromarray(image).resize((TILE, TILE))) for image in images], axis=1)


def _depth(depth: np.ndarray) -> np.ndarray:
    """(row, column) → (row, column, 3) uint8: near is bright, the background black."""
    there = depth > 0
    if not there.any():
        return np.zeros((*depth.shape, 3), np.uint8)
    near, far = depth[there].min(), depth[there].max()
    bright = np.where(there, 255 - 195 * (depth - near) / max(far - near, 1e-9), 0)
    return np.repeat(bright.astype(np.uint8)[..., None], 3, axis=2)
