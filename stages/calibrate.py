"""calibrate: a geometric keypoint detector, its scale and count chosen on the shots; `detect` applies it to every
target."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.detector import Detector
from b23d.schemas.features import GeodesicDistances
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.params import Params, When
from b23d.schemas.shape import NormalizedShape

Factor = Annotated[float, Field(gt=0)]


class Scaled(Params):
    """A detector with lengths, which are fitted to the shots."""

    calibrate: bool = True
    """Choose the scale, and the count if it is None, that do best on the shots."""
    scales: Annotated[tuple[Factor, ...], When(calibrate=True)] = Field(default=(0.5, 0.7, 1.0, 1.4, 2.0), min_length=1)
    """What calibration multiplies the lengths by."""
    threshold: Annotated[float, When(calibrate=True)] = Field(default=0.05, gt=0)
    """Distance at which calibration counts a keypoint as found (unit frame; scores are in the data set's units by
    default)."""


class Iss(Scaled):
    salient_radius: float = Field(default=0.1, gt=0)
    """Ball of the scatter matrix."""
    non_max_radius: float = Field(default=0.06, gt=0)
    """Ball in which a keypoint is the most salient."""
    gamma_21: float = Field(default=0.975, gt=0, le=1)
    """Largest λ2 / λ1 of a keypoint."""
    gamma_32: float = Field(default=0.975, gt=0, le=1)
    """Largest λ3 / λ2 of a keypoint."""
    min_neighbors: int = Field(default=5, ge=1)
    """Points in the ball of the scatter matrix, besides itself, that a keypoint needs."""


class Harris(Scaled):
    radius: float = Field(default=0.1, gt=0)
    """Ball of the quadratic patch; the paper has rings of a mesh."""
    k: float = Field(default=0.04, ge=0, lt=0.25)
    """Harris's constant; from .25 on, no response is above 0."""
    separation: float = Field(default=0.06, gt=0)
    """Clusters: no two points nearer than this. The paper's ρ is .01 of the diagonal, with the strongest points
    clustered."""
    fraction: float = Field(default=0.05, gt=0, le=1)
    """At most this share of the candidates, the strongest."""


class Sift(Scaled):
    min_scale: float = Field(default=0.02, gt=0)
    """Standard deviation of the first Gaussian."""
    octaves: int = Field(default=2, ge=1)
    """Doublings of the standard deviation."""
    scales_per_octave: int = Field(default=3, ge=1)
    """Steps of each doubling."""
    min_contrast: float = Field(default=0.0001, ge=0)
    """Smallest difference of Gaussians of a keypoint; surface variation is within 0 … 1/3."""


class CalibrateParams(Params):
    """Which detector, its constants, and how they are fitted to the shots. Lengths are in the unit frame."""

    method: Literal["farthest", "iss", "harris", "sift"] = "farthest"
    """"farthest": farthest-point sampling along the surface, the paper's baseline; it has no constants. "iss":
    intrinsic shape signatures (Zhong 2009). "harris": HARRIS-3D (Sipiran & Bustos 2011). "sift": SIFT on the surface,
    as the Point Cloud Library has it."""
    count: int | None = Field(default=None, ge=1)
    """How many points at most. None: calibrated, or else ("farthest", or `calibrate = false`) the shots' average,
    rounded."""
    iss: Annotated[Iss, When(method="iss")] = Iss()
    harris: Annotated[Harris, When(method="harris")] = Harris()
    sift: Annotated[Sift, When(method="sift")] = Sift()

    @property
    def chosen(self) -> Scaled | None:
        """The method's own table; None for "farthest"."""
        table: Scaled | None = getattr(self, self.method, None)
        return table


@stage(version=1, hints=Hints(memory_gb=0.5))
def calibrate(
    shot_normalize: list[NormalizedShape],
    shot_geodesic: list[GeodesicDistances],
    shot_keypoints: list[Keypoints],
    params: CalibrateParams,
) -> Detector:
    """The detector with the scale and the count that do best on the shots. It sees the shots only: one serves all
    targets of a draw.

    Raises ValueError: no keypoint in any shot (unless `count` is given and nothing is calibrated); distances that do
    not fit the candidates; a keypoint beyond the cloud.
    """
    from b23d.stages.detectors.calibration import annotated_shot, average_count, choose
    from b23d.stages.detectors.ranking import ranked

    chosen = params.chosen
    calibrated = chosen is not None and chosen.calibrate
    counts = [len(keypoints.ids) for keypoints in shot_keypoints]
    if not any(counts) and (calibrated or params.count is None):
        raise ValueError(
            "shots: expected at least one annotated keypoint, got none; annotate the shots, or draw others"
        )
    constants = {} if chosen is None else chosen.model_dump(exclude=set(Scaled.model_fields))
    options = {name: float(value) for name, value in constants.items()}
    detector = Detector(
        method=params.method,
        scale=1.0,
        count=params.count or average_count(counts),
        options=options,
        shots=[str(i) for i in range(len(shot_normalize))],
    )
    if chosen is None or not chosen.calibrate:
        return detector

    def rank(points: np.ndarray, scale: float) -> np.ndarray:
        return ranked(points, params.method, options, scale)[0]

    each = zip(shot_normalize, shot_geodesic, shot_keypoints, strict=True)
    shots = [annotated_shot(f"shot {i}", *shot) for i, shot in enumerate(each)]
    choice = choose(shots, rank, chosen.scales, chosen.threshold, params.count)
    return detector.model_copy(update={"scale": choice.scale, "count": choice.count, "iou": choice.iou})
