"""import_features: another system's point features, in the place of `backproject` or `reweight`.

```toml
[dataset]
kind = "keypointnet"
root = "path/to/keypointnet"
external_features = "path/to/its/output"         # <id>.npz … for each shape
[feeds]
backproject = "import_features"
```
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.external import External
from b23d.schemas.features import PointFeatures
from b23d.schemas.params import Params
from b23d.schemas.shape import NormalizedShape


class ImportFeaturesParams(Params):
    format: Literal["generic", "d3feat"] = "generic"
    """The file's format; `stages/imports/features.py` describes each."""
    frame: Literal["source", "unit"] = "source"
    """Of points in the file."""
    reach: float = Field(default=0.05, gt=0)
    """A candidate whose nearest point in the file is farther than this (unit frame) counts as not observed."""


@stage(version=1, hints=Hints(memory_gb=0.5))
def import_features(
    normalize: NormalizedShape, external_features: External, params: ImportFeaturesParams
) -> PointFeatures:
    """Another system's point features on the candidates: `[feeds] backproject = "import_features"` (smoothed by
    `reweight`), or `reweight`.

    Without points, row i is candidate i. With points, each candidate takes its nearest one's feature.

    Raises ValueError, naming the shape: a file that is not as its format says, features that are not finite in half
    precision, another number of rows than candidates, points that are not near the shape.
    """
    from b23d.stages.imports.features import READERS
    from b23d.stages.imports.placing import in_unit_frame, nearest_candidates

    name = external_features.shape
    features, points = READERS[params.format](external_features)
    if points is None:
        if len(features) != len(normalize.points):
            raise ValueError(
                f"{name}: expected features of {len(normalize.points)} candidates, got {len(features)}; "
                "store `points` with them"
            )
        observed = np.ones(len(features), bool)
    else:
        from scipy.spatial import cKDTree

        nearest_candidates(name, points, normalize, params.frame)  # points far from the shape are an error
        gaps, at = cKDTree(in_unit_frame(points, normalize, params.frame)).query(normalize.points.astype(np.float64))
        features, observed = features[at], gaps <= params.reach
    with np.errstate(over="ignore"):  # what overflows is refused below
        half = features.astype(np.float16)
    if not np.isfinite(half).all():
        raise ValueError(f"{name}: expected finite features within ±65504, got others; scale them, or mend the file")
    return PointFeatures(
        features=half, counts=observed.astype(np.int32), observed=observed, descriptor=f"imported {params.format}"
    )
