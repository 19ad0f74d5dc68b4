"""Exporters of `b23d show RUN SHAPE STAGE --export FILE`: ply, glb, png, parquet. Geometry is in the unit frame, +y up.

| artifact | ply, glb | png | parquet |
|---|---|---|---|
| NormalizedShape | the mesh or cloud with its colours (glb: with its texture) | a picture | |
| PointFeatures | candidates in PCA colours fitted on the class; scalars `count`, `observed` | the same | |
| GeodesicDistances | candidates coloured by their distance from candidate 0; scalar `distance` | the same | |
| Prediction | the shape; keypoints as spheres, annotated ones small and black | discs, rings | all of the run |
| Views | | contact sheet | |
| ViewTokens | | contact sheet in PCA colours | |
| ShapeScore | | | all of the run |
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from b23d.pipeline.run import Run
from b23d.schemas.artifact import Artifact
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.predictions import Prediction
from b23d.schemas.scores import ShapeScore
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.views import Views, ViewTokens
from b23d.stages.workbench.commands.thumbnails import distance_colors, token_colors
from b23d.stages.workbench.pictures.coloring import class_basis, feature_colors
from b23d.stages.workbench.pictures.painting import GREY, Mark, marks
from b23d.stages.workbench.pictures.palette import id_color, rgb
from b23d.stages.workbench.pictures.solids import (
    RADIUS,
    TRUE_RADIUS,
    Part,
    merged,
    octahedra,
    sphere,
    write_glb,
    write_ply,
)
from b23d.stages.workbench.results.gathering import Entry, Gathering

PICTURE = 800  # pixels
TILE, ACROSS = 224, 8  # of a contact sheet
BLACK = (17, 24, 39)


def ply(run: Run, shape: str, stage: str, draw: int | None, artifact: Artifact, path: Path) -> None:
    """A binary PLY; scalars as vertex properties, one of them as MeshLab's `quality`. Raises ValueError for what has no
    geometry."""
    parts = _parts(run, shape, stage, draw, artifact, "ply")
    one = parts[0] if len(parts) == 1 else merged(parts)
    names = [f"part {i}: {part.name}" for i, part in enumerate(parts)] if len(parts) > 1 else []
    write_ply(one, path, [f"{stage} of {shape}, run {run.name}; unit frame, +y up", *names])


def glb(run: Run, shape: str, stage: str, draw: int | None, artifact: Artifact, path: Path) -> None:
    """A binary glTF scene with a named node for every keypoint. Raises ValueError for what has no geometry."""
    write_glb(_parts(run, shape, stage, draw, artifact, "glb"), path)


def png(run: Run, shape: str, stage: str, draw: int | None, artifact: Artifact, path: Path) -> None:
    """A picture of the shape, or all views side by side. Raises ValueError for what has no picture."""
    from PIL import Image

    from b23d.stages.workbench.pictures.painting import picture

    if isinstance(artifact, Views):
        Image.fromarray(contact_sheet(artifact.images)).save(path)
        return
    if isinstance(artifact, ViewTokens):
        Image.fromarray(contact_sheet(token_colors(artifact.tokens), Image.Resampling.NEAREST)).save(path)
        return
    entry = _entry(run, shape)
    base = artifact if isinstance(artifact, NormalizedShape) else entry.normalized
    if base is None or not isinstance(artifact, NormalizedShape | PointFeatures | GeodesicDistances | Prediction):
        raise ValueError(_refusal("png", stage, artifact))
    found = marks(entry, artifact) if isinstance(artifact, Prediction) else []
    Image.fromarray(picture(base, _candidate_colors(run, shape, stage, artifact), PICTURE, found)).save(path)


def parquet(run: Run, shape: str, stage: str, draw: int | None, artifact: Artifact, path: Path) -> None:
    """Of a prediction or score: the whole run's, as a table. Raises ValueError for anything else."""
    from b23d.stages.workbench.results.tables import prediction_table, score_rows

    if isinstance(artifact, Prediction):
        prediction_table(run).to_parquet(path, index=False)
    elif isinstance(artifact, ShapeScore):
        score_rows(run).to_parquet(path, index=False)
    else:
        raise ValueError(_refusal("parquet", stage, artifact))


def contact_sheet(images: np.ndarray, resampling: int | None = None) -> np.ndarray:
    """Views (view, row, column, 3) uint8 in lines of eight, 224 pixels each, smaller ones as they are unless a
    `resampling` (Pillow's) enlarges them; (…, …, 3) uint8 on white."""
    from PIL import Image

    size = TILE if resampling is not None else min(TILE, images.shape[1])
    tiles = [np.asarray(Image.fromarray(image).resize((size, size), resampling)) for image in images]
    lines = -(-len(tiles) // ACROSS)
    sheet = np.full((lines * ACROSS, size, size, 3), 255, np.uint8)
    sheet[: len(tiles)] = tiles
    return sheet.reshape(lines, ACROSS, size, size, 3).swapaxes(1, 2).reshape(lines * size, ACROSS * size, 3)


def _parts(run: Run, shape: str, stage: str, draw: int | None, artifact: Artifact, suffix: str) -> list[Part]:
    if isinstance(artifact, NormalizedShape):
        return [_shape_part(artifact)]
    normalized = (
        run.artifact(shape, "normalize")
        if isinstance(artifact, PointFeatures | GeodesicDistances | Prediction)
        else None
    )
    if not isinstance(normalized, NormalizedShape):
        raise ValueError(_refusal(suffix, stage, artifact))
    if isinstance(artifact, Prediction):
        points = normalized.points
        base = _shape_part(normalized) if normalized.kind == "mesh" else octahedra("shape", points, _grey(len(points)))
        return [base, *(_ball(mark) for mark in marks(_entry(run, shape), artifact))]
    colors = _candidate_colors(run, shape, stage, artifact)
    assert colors is not None
    scalars = {}
    if isinstance(artifact, PointFeatures):
        scalars = {"count": artifact.counts.astype(np.float32), "observed": artifact.observed.astype(np.float32)}
    elif isinstance(artifact, GeodesicDistances):
        scalars = {"distance": artifact.distances[0].astype(np.float32)}
    return [Part("candidates", normalized.points, colors, scalars=scalars)]


def _candidate_colors(run: Run, shape: str, stage: str, artifact: Artifact) -> np.ndarray | None:
    if isinstance(artifact, PointFeatures):
        return feature_colors(artifact, class_basis(Gathering(run), shape.rsplit("/", 1)[0], stage))
    return distance_colors(artifact) if isinstance(artifact, GeodesicDistances) else None


def _shape_part(shape: NormalizedShape) -> Part:
    if shape.face_uvs is not None and shape.texture is not None:  # corners of their own: a vertex may have several uvs
        corners = np.arange(3 * len(shape.faces), dtype=np.int32).reshape(-1, 3)
        vertices = shape.vertices[shape.faces].reshape(-1, 3)
        uvs = shape.face_uvs.reshape(-1, 2)
        return Part("shape", vertices, _sampled(shape.texture, uvs), corners, uvs=uvs, texture=shape.texture)
    colors = shape.vertex_colors if shape.vertex_colors is not None else _grey(len(shape.vertices))
    faces = shape.faces if shape.kind == "mesh" else np.zeros((0, 3), np.int32)
    return Part("shape", shape.vertices, colors, faces)


def _sampled(texture: np.ndarray, uvs: np.ndarray) -> np.ndarray:
    """(n, 3) uint8: the texture's pixel at each place (n, 2), origin at the lower left, repeated outside."""
    rows, columns = texture.shape[:2]
    column = np.floor(uvs[:, 0] % 1 * columns).astype(np.int64).clip(0, columns - 1)
    row = np.floor((1 - uvs[:, 1]) % 1 * rows).astype(np.int64).clip(0, rows - 1)
    return texture[row, column]


def _ball(mark: Mark) -> Part:
    if mark.true:
        return sphere(f"annotated {mark.id}", mark.position, TRUE_RADIUS, BLACK)
    return sphere(f"predicted {mark.id}", mark.position, RADIUS, rgb(id_color(mark.id)))


def _entry(run: Run, shape: str) -> Entry:
    return Gathering(run).entry(next(item for item in run.shapes if item.name == shape))


def _grey(count: int) -> np.ndarray:
    return np.tile(np.array(GREY, np.uint8), (count, 1))


def _refusal(suffix: str, stage: str, artifact: Artifact) -> str:
    """What each format is for, where another was asked of it."""
    takes = {
        "ply": "geometry, features, distances or a prediction",
        "png": "views, tokens, geometry, features, distances or a prediction",
        "parquet": "a prediction or a score",
    }
    expected = takes.get(suffix, takes["ply"])
    return f".{suffix} export: expected {expected}, got {type(artifact).__name__} from {stage}; write it as .npz"
