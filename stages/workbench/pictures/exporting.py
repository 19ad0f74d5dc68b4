"""Exporters of `b23d show RUN SHAPE STAGE --export FILE`. Geometry is in the shape's own file's frame, so that it lies
over the file in MeshLab or Blender, or in the unit frame where that is asked for.

| artifact | ply, glb, obj | npz | png | parquet |
|---|---|---|---|---|
| NormalizedShape | the mesh or cloud, its colours (glb, obj: texture) | arrays | a picture | |
| PointFeatures | candidates, PCA colours of the class; `count`, `observed` | with `points` | the same | |
| GeodesicDistances | candidates coloured by `distance` from candidate 0 | with `points` | the same | |
| Prediction | the file's shape; predicted keypoints, annotated ones small and black | arrays | discs | of the run |
| Views | | arrays | contact sheet | |
| ViewTokens | | arrays | contact sheet in PCA colours | |
| ShapeScore | | arrays | | of the run |
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from b23d.pipeline.errors import ArtifactNotFoundError
from b23d.pipeline.inspection.artifact import FrameName
from b23d.pipeline.run import Run
from b23d.schemas.artifact import Artifact
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.predictions import Prediction
from b23d.schemas.scores import ShapeScore
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.views import Views, ViewTokens
from b23d.stages.workbench.pictures.coloring import class_basis, feature_colors
from b23d.stages.workbench.pictures.export_arrays import write_arrays
from b23d.stages.workbench.pictures.frames import in_frame, original, shape_part
from b23d.stages.workbench.pictures.obj_files import write_obj
from b23d.stages.workbench.pictures.painting import GREY, Mark, marks
from b23d.stages.workbench.pictures.palette import id_color, rgb
from b23d.stages.workbench.pictures.solids import (
    RADIUS,
    TRUE_RADIUS,
    SceneObject,
    merged,
    octahedra,
    sphere,
    write_glb,
    write_ply,
)
from b23d.stages.workbench.pictures.thumbnails import distance_colors, token_colors
from b23d.stages.workbench.results.gathering import Gathering, ShapeResults

PICTURE = 800  # pixels
TILE, ACROSS = 224, 8  # of a contact sheet
BLACK = (17, 24, 39)
FRAMES: dict[FrameName, str] = {"file": "in the coordinates of its own file", "unit": "unit frame, +y up"}


def ply(run: Run, shape: str, stage: str, draw: int | None, artifact: Artifact, path: Path, frame: FrameName) -> None:
    """A binary PLY; scalars as vertex properties, one of them as MeshLab's `quality`. Raises ValueError for what has no
    geometry."""
    parts = _parts(run, shape, stage, draw, artifact, "ply", frame)
    one = parts[0] if len(parts) == 1 else merged(parts)
    names = [f"part {i}: {part.name}" for i, part in enumerate(parts)] if len(parts) > 1 else []
    write_ply(one, path, [f"{stage} of {shape}, run {run.name}; {FRAMES[frame]}", *names])


def glb(run: Run, shape: str, stage: str, draw: int | None, artifact: Artifact, path: Path, frame: FrameName) -> None:
    """A binary glTF scene with a named node for every keypoint. Raises ValueError for what has no geometry."""
    write_glb(_parts(run, shape, stage, draw, artifact, "glb", frame), path)


def obj(run: Run, shape: str, stage: str, draw: int | None, artifact: Artifact, path: Path, frame: FrameName) -> None:
    """An OBJ with a named object for every keypoint, its material and texture in files beside it. Raises ValueError for
    what has no geometry."""
    parts = _parts(run, shape, stage, draw, artifact, "obj", frame)
    write_obj(parts, path, f"{stage} of {shape}, run {run.name}; {FRAMES[frame]}")


def npz(run: Run, shape: str, stage: str, draw: int | None, artifact: Artifact, path: Path, frame: FrameName) -> None:
    """Every array and field; places and lengths in `frame`, and of features and distances the `points` they are at."""
    write_arrays(artifact, _normalized(run, shape) if "normalize" in run.config.stages else None, path, frame)


def png(run: Run, shape: str, stage: str, draw: int | None, artifact: Artifact, path: Path, frame: FrameName) -> None:
    """A picture of the shape, or all views side by side. Raises ValueError for what has no picture."""
    from PIL import Image

    from b23d.stages.workbench.pictures.painting import picture

    if isinstance(artifact, Views):
        Image.fromarray(contact_sheet(artifact.images)).save(path)
        return
    if isinstance(artifact, ViewTokens):
        Image.fromarray(contact_sheet(token_colors(artifact), Image.Resampling.NEAREST)).save(path)
        return
    entry = _entry(run, shape)
    base = artifact if isinstance(artifact, NormalizedShape) else entry.normalized
    if base is None or not isinstance(artifact, NormalizedShape | PointFeatures | GeodesicDistances | Prediction):
        raise ValueError(_refusal("png", stage, artifact))
    found = marks(entry, artifact) if isinstance(artifact, Prediction) else []
    Image.fromarray(picture(base, _candidate_colors(run, shape, stage, artifact), PICTURE, found)).save(path)


def parquet(
    run: Run, shape: str, stage: str, draw: int | None, artifact: Artifact, path: Path, frame: FrameName
) -> None:
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


def _parts(
    run: Run, shape: str, stage: str, draw: int | None, artifact: Artifact, suffix: str, frame: FrameName
) -> list[SceneObject]:
    if not isinstance(artifact, NormalizedShape | PointFeatures | GeodesicDistances | Prediction):
        raise ValueError(_refusal(suffix, stage, artifact))
    normalized = artifact if isinstance(artifact, NormalizedShape) else _normalized(run, shape)
    if normalized is None:
        raise ValueError(_refusal(suffix, stage, artifact))
    if isinstance(artifact, NormalizedShape):
        parts = [shape_part(artifact)]
    elif isinstance(artifact, Prediction):
        points = normalized.points
        mesh = normalized.kind == "mesh"
        base = shape_part(original(run, shape, normalized)) if mesh else octahedra("shape", points, _grey(len(points)))
        parts = [base, *(_ball(mark) for mark in marks(_entry(run, shape), artifact))]
    else:
        colors = _candidate_colors(run, shape, stage, artifact)
        assert colors is not None
        parts = [SceneObject("candidates", normalized.points, colors, scalars=_scalars(artifact))]
    return [replace(part, vertices=in_frame(part.vertices, normalized, frame)) for part in parts]


def _scalars(artifact: PointFeatures | GeodesicDistances) -> dict[str, np.ndarray]:
    if isinstance(artifact, PointFeatures):
        return {"count": artifact.counts.astype(np.float32), "observed": artifact.observed.astype(np.float32)}
    return {"distance": artifact.distances[0].astype(np.float32)}


def _normalized(run: Run, shape: str) -> NormalizedShape | None:
    try:
        found = run.artifact(shape, "normalize")
    except ArtifactNotFoundError:
        return None
    return found if isinstance(found, NormalizedShape) else None


def _candidate_colors(run: Run, shape: str, stage: str, artifact: Artifact) -> np.ndarray | None:
    if isinstance(artifact, PointFeatures):
        return feature_colors(artifact, class_basis(Gathering(run), shape.rsplit("/", 1)[0], stage))
    return distance_colors(artifact) if isinstance(artifact, GeodesicDistances) else None


def _ball(mark: Mark) -> SceneObject:
    if mark.true:
        return sphere(f"annotated {mark.id}", mark.position, TRUE_RADIUS, BLACK)
    return sphere(f"predicted {mark.id}", mark.position, RADIUS, rgb(id_color(mark.id)))


def _entry(run: Run, shape: str) -> ShapeResults:
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
