"""import_predictions: keypoints that another system found, in the place of `optimize`.

```toml
[dataset]
kind = "keypointnet"
root = "path/to/keypointnet"
external_predictions = "path/to/its/output"      # <id>.npz … for each shape
[feeds]
optimize = "import_predictions"
[stages.import_predictions]
format = "d3feat"
keep = "average"
```
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.external import External
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.params import Params, When
from b23d.schemas.predictions import Prediction
from b23d.schemas.shape import NormalizedShape


class Voxels(Params):
    """Where the voxels of "sift3d-csv" are."""

    spacing: float = Field(default=1.0, gt=0)
    """Side of a voxel, in the frame's unit."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where voxel (0, 0, 0) is, in the frame."""


class ImportPredictionsParams(Params):
    format: Literal["generic", "usip", "d3feat", "ukpgan", "fskd", "sift3d-csv"] = "generic"
    """The file's format; `stages/imports/predictions.py` describes each, and says which are the published programs'
    own."""
    frame: Literal["source", "unit"] = "source"
    """Of points in the file: the data set's own frame, or the unit frame (bounding box centred, longest side 1)."""
    min_score: float | None = None
    """Only points with a score above it. None: all, but .5 with "ukpgan" (its own evaluation)."""
    nms_radius: float | None = Field(default=None, ge=0)
    """Of points nearer than this to one another (in the file's frame), only the best. None: none, but .1 with
    "ukpgan"."""
    keep: Literal["all", "average"] | Annotated[int, Field(ge=1)] = "all"
    """How many of the best: all, the shots' average number of keypoints (rounded), or a number. Best by score, then by
    place in it."""
    sift3d_csv: Annotated[Voxels, When(format="sift3d-csv")] = Voxels()


@stage(version=1, hints=Hints(memory_gb=0.2))
def import_predictions(
    normalize: NormalizedShape,
    external_predictions: External,
    shot_keypoints: list[Keypoints],
    params: ImportPredictionsParams,
) -> Prediction:
    """Another system's keypoints, each at its nearest candidate; ids are -1 where the file has none. The shots give a
    number only.

    `costs` are -score (0 without scores), `objective` their sum. Two points may share a candidate, and count as two.

    Raises ValueError, naming the shape: a file that is not as its format says, an index beyond the candidates or
    indices where the candidates are not the data set's cloud, points that are not near the shape.
    """
    from b23d.stages.detectors.calibration import average_count
    from b23d.stages.imports.placing import nearest_candidates
    from b23d.stages.imports.predictions import READERS, choose

    name = external_predictions.shape
    read = READERS[params.format](external_predictions, normalize.to_source(normalize.points), params)
    least, radius = params.min_score, params.nms_radius
    if params.format == "ukpgan":
        least, radius = 0.5 if least is None else least, 0.1 if radius is None else radius
    most = params.keep if isinstance(params.keep, int) else None
    if params.keep == "average":
        most = average_count([len(keypoints.ids) for keypoints in shot_keypoints])
    if least is not None and read.scores is None:
        raise ValueError(
            f"{name}: expected scores in a {params.format} file, got none; drop stages.import_predictions.min_score"
        )
    chosen = choose(read, least, radius, most)
    at = (
        _indices(name, read.indices, normalize)
        if read.indices is not None
        else nearest_candidates(name, read.points, normalize, params.frame)[0]
    )
    scores = np.zeros(len(at), np.float32) if read.scores is None else read.scores.astype(np.float32)
    ids = np.full(len(at), -1, np.int32) if read.ids is None else read.ids.astype(np.int32)
    return Prediction(
        ids=ids[chosen],
        points=at[chosen].astype(np.int32),
        positions=normalize.points[at[chosen]],
        present=np.ones(len(chosen), bool),
        costs=-scores[chosen],
        objective=-float(scores[chosen].sum()),
        method=f"imported {params.format}",
    )


def _indices(name: str, indices: np.ndarray, shape: NormalizedShape) -> np.ndarray:
    if shape.candidates != "cloud":
        raise ValueError(
            f'{name}: expected candidates "cloud", which indices count, got "{shape.candidates}"; store points instead'
        )
    if len(indices) and not 0 <= indices.min() <= indices.max() < len(shape.points):
        raise ValueError(
            f"{name}: expected indices below {len(shape.points)}, got {indices.min()} … {indices.max()}; "
            "index the same cloud"
        )
    return indices.astype(np.int64)
