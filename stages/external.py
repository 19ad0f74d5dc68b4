"""import_predictions, import_features: what another system found, in the place of `optimize` and of `backproject` or `reweight`.

```toml
[dataset]
kind = "keypointnet"
root = "path/to/keypointnet"
external_predictions = "path/to/its/output"      # <id>.npz … for each shape; external_features the same
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

from pipeline.stage import Hints, stage
from schemas.external import External
from schemas.features import PointFeatures
from schemas.keypoints import Prediction
from schemas.params import Params
from schemas.shape import Keypoints, NormalizedShape

FAR = 0.1
"""Half of a file's points farther than this from the shape (unit frame): it is in another frame, or about another shape."""


class ImportPredictionsParams(Params):
    format: Literal["generic", "usip", "d3feat", "ukpgan", "fskd", "sift3d-csv"] = "generic"
    """The file's format; `stages/external_formats/predictions.py` describes each, and says which are the published programs' own."""
    frame: Literal["source", "unit"] = "source"
    """Of points in the file: the data set's own frame, or the unit frame (bounding box centred, longest side 1)."""
    min_score: float | None = None
    """Only points with a score above it. None: all, but .5 with "ukpgan" (its own evaluation)."""
    nms_radius: float | None = Field(default=None, ge=0)
    """Of points nearer than this to one another (in the file's frame), only the best. None: none, but .1 with "ukpgan"."""
    keep: Literal["all", "average"] | Annotated[int, Field(ge=1)] = "all"
    """How many of the best: all, the shots' average number of keypoints (rounded), or a number. Best by score, then by place in it."""
    spacing: float = Field(default=1.0, gt=0)
    """"sift3d-csv": side of a voxel, in the frame's unit."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """"sift3d-csv": where voxel (0, 0, 0) is, in the frame."""


class ImportFeaturesParams(Params):
    format: Literal["generic", "d3feat"] = "generic"
    """The file's format; `stages/external_formats/features.py` describes each."""
    frame: Literal["source", "unit"] = "source"
    """Of points in the file."""
    reach: float = Field(default=0.05, gt=0)
    """A candidate whose nearest point in the file is farther than this (unit frame) counts as not observed."""


@stage(version=1, hints=Hints(memory_gb=0.2))
def import_predictions(
    normalize: NormalizedShape, external_predictions: External, shot_keypoints: list[Keypoints], params: ImportPredictionsParams
) -> Prediction:
    """Another system's keypoints, each at its nearest candidate; ids are -1 where the file has none. The shots give a number only.

    `costs` are -score (0 without scores), `objective` their sum. Two points may share a candidate, and count as two.

    Raises ValueError, naming the shape: a file that is not as its format says, an index beyond the candidates or indices where the
    candidates are not the data set's cloud, points that are not near the shape.
    """
    from stages.detectors.calibration import average_count
    from stages.external_formats.predictions import READERS, choose

    name = external_predictions.shape
    read = READERS[params.format](external_predictions, normalize.to_source(normalize.points), params)
    least, radius = params.min_score, params.nms_radius
    if params.format == "ukpgan":
        least, radius = 0.5 if least is None else least, 0.1 if radius is None else radius
    most = params.keep if isinstance(params.keep, int) else None
    if params.keep == "average":
        most = average_count([len(keypoints.ids) for keypoints in shot_keypoints])
    if least is not None and read.scores is None:
        raise ValueError(f"{name}: expected scores in a {params.format} file, got none; drop stages.import_predictions.min_score")
    chosen = choose(read, least, radius, most)
    at = _indices(name, read.indices, normalize) if read.indices is not None else _nearest(name, read.points, normalize, params.frame)[0]
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


@stage(version=1, hints=Hints(memory_gb=0.5))
def import_features(normalize: NormalizedShape, external_features: External, params: ImportFeaturesParams) -> PointFeatures:
    """Another system's point features on the candidates: `[feeds] backproject = "import_features"` (smoothed by `reweight`), or `reweight`.

    Without points, row i is candidate i. With points, each candidate takes its nearest one's feature.

    Raises ValueError, naming the shape: a file that is not as its format says, features that are not finite in half precision,
    another number of rows than candidates, points that are not near the shape.
    """
    from stages.external_formats.features import READERS

    name = external_features.shape
    features, points = READERS[params.format](external_features)
    if points is None:
        if len(features) != len(normalize.points):
            raise ValueError(
                f"{name}: expected features of {len(normalize.points)} candidates, got {len(features)}; store `points` with them"
            )
        observed = np.ones(len(features), bool)
    else:
        from scipy.spatial import cKDTree

        _nearest(name, points, normalize, params.frame)  # points far from the shape are an error
        gaps, at = cKDTree(_unit(points, normalize, params.frame)).query(normalize.points.astype(np.float64))
        features, observed = features[at], gaps <= params.reach
    with np.errstate(over="ignore"):  # what overflows is refused below
        half = features.astype(np.float16)
    if not np.isfinite(half).all():
        raise ValueError(f"{name}: expected finite features within ±65504, got others; scale them, or mend the file")
    return PointFeatures(features=half, counts=observed.astype(np.int32), observed=observed, descriptor=f"imported {params.format}")


def _unit(points: np.ndarray, shape: NormalizedShape, frame: str) -> np.ndarray:
    return points.astype(np.float64) if frame == "unit" else shape.to_unit(points)


def _nearest(name: str, points: np.ndarray, shape: NormalizedShape, frame: str) -> tuple[np.ndarray, np.ndarray]:
    """The candidate nearest to each point, (k,), and its distance in the unit frame."""
    from scipy.spatial import cKDTree

    if not np.isfinite(points).all():
        raise ValueError(f"{name}: expected finite points, got NaN or infinity; mend the file")
    gaps, at = cKDTree(shape.points.astype(np.float64)).query(_unit(points, shape, frame))
    if len(gaps) and np.median(gaps) > FAR:
        raise ValueError(
            f"{name}: expected points on the shape, got half of them farther than {np.median(gaps):.3g} from it "
            f'(longest side 1); are they in the {frame} frame, of this shape? set frame to "source" or "unit"'
        )
    return at.astype(np.int64), gaps


def _indices(name: str, indices: np.ndarray, shape: NormalizedShape) -> np.ndarray:
    if shape.candidates != "cloud":
        raise ValueError(f'{name}: expected candidates "cloud", which indices count, got "{shape.candidates}"; store points instead')
    if len(indices) and not 0 <= indices.min() <= indices.max() < len(shape.points):
        raise ValueError(f"{name}: expected indices below {len(shape.points)}, got {indices.min()} … {indices.max()}; index the same cloud")
    return indices.astype(np.int64)
