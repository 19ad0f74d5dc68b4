"""detect: points that stand out by their geometry, in the place of `optimize`: `[feeds] optimize = "detect"`.

Which detector, and its constants, is said to `calibrate`, which fits it to the shots:

```toml
[feeds]
optimize = "detect"
[stages.calibrate]
method = "iss"
```
"""

from __future__ import annotations

import numpy as np

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.detector import Detector
from b23d.schemas.features import GeodesicDistances
from b23d.schemas.params import Params
from b23d.schemas.predictions import Prediction
from b23d.schemas.shape import NormalizedShape


class DetectParams(Params):
    """None: the detector knows all. `calibrate` has the method and its constants."""


@stage(version=2, hints=Hints(memory_gb=0.5))
def detect(
    normalize: NormalizedShape, geodesic: GeodesicDistances, calibrate: Detector, params: DetectParams
) -> Prediction:
    """Points of interest, strongest first, without names: ids are -1 and all are present. The shots give number and
    scale only.

    There may be fewer than wanted, or none. `costs` are -strength (the detector's response; for "farthest" the distance
    from the points before), `objective` their sum: not comparable between methods. `method` says what was applied, as
    `iss scale 0.7 count 9`.

    Raises ValueError: distances that do not fit the candidates.
    """
    from b23d.stages.detectors.farthest import farthest
    from b23d.stages.detectors.ranking import ranked
    from b23d.stages.solvers.shots import check_fit

    points, detector = normalize.points.astype(np.float64), calibrate
    check_fit("the target", normalize, distances=geodesic)
    if detector.method == "farthest":
        chosen, strength = farthest(geodesic.distances, detector.count)
        applied = f"farthest count {detector.count}"
    else:
        chosen, strength = ranked(points, detector.method, detector.options, detector.scale)
        applied = f"{detector.method} scale {detector.scale:g} count {detector.count}"
    chosen, strength = chosen[: detector.count], strength[: detector.count]
    return Prediction(
        ids=np.full(len(chosen), -1, np.int32),
        points=chosen.astype(np.int32),
        positions=normalize.points[chosen],
        present=np.ones(len(chosen), bool),
        costs=-strength.astype(np.float32),
        objective=-float(strength.sum()),
        method=applied,
        shots=detector.shots,
    )
