"""A shape as its file has it, in the file's frame or in the unit frame, as a part to export."""

from __future__ import annotations

import numpy as np

from b23d.pipeline.inspection.artifact import FrameName
from b23d.pipeline.run import Run
from b23d.schemas.shape import NormalizedShape, Source
from b23d.stages.normalize import NormalizeParams, normalize
from b23d.stages.workbench.pictures.painting import GREY
from b23d.stages.workbench.pictures.solids import SceneObject


def in_frame(vertices: np.ndarray, shape: NormalizedShape, frame: FrameName) -> np.ndarray:
    """(v, 3) of the unit frame, float64 in the file's."""
    return shape.to_source(vertices.astype(np.float64)) if frame == "file" else vertices


def original(run: Run, shape: str, normalized: NormalizedShape) -> NormalizedShape:
    """The shape with its file's own surface and colours, where the run has replaced it by a watertight one: the frame
    is the same."""
    if "watertight_faces" not in normalized.repairs:
        return normalized
    leaf = next(item for item in run.shapes if item.name == shape).leaves["source"]
    source = leaf.read()
    params = run.config.params["normalize"]
    assert isinstance(source, Source) and isinstance(params, NormalizeParams)
    stands = source.model_copy(update={"up": normalized.up})  # found, where the run file leaves it to be found
    return normalize(stands, params.model_copy(update={"watertight": False, "candidates": "fps", "count": 1}))


def shape_part(shape: NormalizedShape) -> SceneObject:
    """The surface with its texture or colours, or the cloud's points; unit frame."""
    if shape.face_uvs is not None and shape.texture is not None:  # corners of their own: a vertex may have several uvs
        corners = np.arange(3 * len(shape.faces), dtype=np.int32).reshape(-1, 3)
        vertices = shape.vertices[shape.faces].reshape(-1, 3)
        uvs = shape.face_uvs.reshape(-1, 2)
        return SceneObject("shape", vertices, sampled(shape.texture, uvs), corners, uvs=uvs, texture=shape.texture)
    grey = np.tile(np.array(GREY, np.uint8), (len(shape.vertices), 1))
    faces = shape.faces if shape.kind == "mesh" else np.zeros((0, 3), np.int32)
    return SceneObject("shape", shape.vertices, grey if shape.vertex_colors is None else shape.vertex_colors, faces)


def sampled(texture: np.ndarray, uvs: np.ndarray) -> np.ndarray:
    """(n, 3) uint8: the texture's pixel at each place (n, 2), origin at the lower left, repeated outside."""
    rows, columns = texture.shape[:2]
    column = np.floor(uvs[:, 0] % 1 * columns).astype(np.int64).clip(0, columns - 1)
    row = np.floor((1 - uvs[:, 1]) % 1 * rows).astype(np.int64).clip(0, rows - 1)
    return texture[row, column]
