"""An artifact as `.npz`: every array and field, with the points that features and distances belong to."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from b23d.pipeline.inspection.artifact import MARK, FrameName
from b23d.schemas.artifact import Artifact
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.predictions import PartPrediction
from b23d.schemas.shape import NormalizedShape

UNIT = "unit frame"
"""The unit by which schemas mark places (last axis 3) and lengths."""


def write_arrays(artifact: Artifact, shape: NormalizedShape | None, path: Path, frame: FrameName) -> None:
    """Every array of the artifact, those in the unit frame in `frame`; of what is given per candidate, `points` (n, 3)
    as well. `fields`: the other fields as JSON, with the frame.

    shape: whose frame it is; None: everything stays in the unit frame.
    """
    shape = artifact if isinstance(artifact, NormalizedShape) else shape
    arrays = dict(artifact.present_arrays())
    if shape is not None and isinstance(artifact, PointFeatures | GeodesicDistances | PartPrediction):
        arrays["points"] = shape.points
    if shape is None:
        frame = "unit"
    if shape is not None and frame == "file":
        specs = type(artifact).array_specs()
        for name in arrays:
            if name == "points" or specs[name].unit == UNIT:
                arrays[name] = _to_file(arrays[name], shape)
    fields = {**artifact.plain_fields(), "frame": frame, "made_by": MARK}
    content: dict[str, Any] = {**arrays, "fields": np.array(json.dumps(fields))}
    np.savez_compressed(path, **content)


def _to_file(array: np.ndarray, shape: NormalizedShape) -> np.ndarray:
    """Places, or lengths, of the unit frame in the file's: float64."""
    wide = array.astype(np.float64)
    return shape.to_source(wide) if array.shape[-1:] == (3,) else wide * shape.scale
