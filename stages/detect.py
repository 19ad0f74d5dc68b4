"""detect: points that stand out by their geometry, in the place of `optimize`: `[feeds] optimize = "detect"`."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Literal

import numpy as np
from pydantic import Field

from pipeline.stage import Hints, stage
from schemas.features import GeodesicDistances
from schemas.keypoints import Prediction
from schemas.params import Params
from schemas.shape import Keypoints, NormalizedShape

if TYPE_CHECKING:
    from stages.detectors.calibration import Choice

Factor = Annotated[float, Field(gt=0)]
Shot = tuple[bytes, bytes]
"""Its candidates (n, 3) float32, and their distances from its keypoints (n, g) float16."""


class DetectParams(Params):
    """Lengths are in the unit frame."""

    method: Literal["farthest", "iss", "harris", "sift"] = "farthest"
    """"farthest": farthest-point sampling along the surface, the paper's baseline. "iss": intrinsic shape signatures (Zhong 2009).
    "harris": HARRIS-3D (Sipiran & Bustos 2011). "sift": SIFT on the surface, as the Point Cloud Library has it."""
    count: int | None = Field(default=None, ge=1)
    """How many points at most. None: calibrated, or else ("farthest", or `calibrate = false`) the shots' average, rounded."""
    calibrate: bool = True
    """Choose the scale and the count that do best on the shots. Nothing to "farthest", which has no scale."""
    scales: tuple[Factor, ...] = Field(default=(0.5, 0.7, 1.0, 1.4, 2.0), min_length=1)
    """What calibration multiplies the method's lengths by."""
    threshold: float = Field(default=0.05, gt=0)
    """Distance at which calibration counts a keypoint as found (unit frame; scores are in the data set's units by default)."""
    iss_salient_radius: float = Field(default=0.1, gt=0)
    """Ball of the scatter matrix."""
    iss_non_max_radius: float = Field(default=0.06, gt=0)
    """Ball in which a keypoint is the most salient."""
    iss_gamma_21: float = Field(default=0.975, gt=0, le=1)
    """Largest λ2 / λ1 of a keypoint."""
    iss_gamma_32: float = Field(default=0.975, gt=0, le=1)
    """Largest λ3 / λ2 of a keypoint."""
    iss_min_neighbors: int = Field(default=5, ge=1)
    harris_radius: float = Field(default=0.1, gt=0)
    """Ball of the quadratic patch; the paper has rings of a mesh."""
    harris_k: float = Field(default=0.04, ge=0, lt=0.25)
    """Harris's constant; from .25 on, no response is above 0."""
    harris_separation: float = Field(default=0.06, gt=0)
    """Clusters: no two points nearer than this. The paper's ρ is .01 of the diagonal, with the strongest points clustered."""
    harris_fraction: float = Field(default=0.05, gt=0, le=1)
    """At most this share of the candidates, the strongest."""
    sift_min_scale: float = Field(default=0.02, gt=0)
    """Standard deviation of the first Gaussian."""
    sift_octaves: int = Field(default=2, ge=1)
    sift_scales_per_octave: int = Field(default=3, ge=1)
    sift_min_contrast: float = Field(default=0.0001, ge=0)
    """Smallest difference of Gaussians of a keypoint; surface variation is within 0 … 1/3."""


@stage(version=1, hints=Hints(memory_gb=0.5))
def detect(
    normalize: NormalizedShape,
    geodesic: GeodesicDistances,
    shot_normalize: list[NormalizedShape],
    shot_geodesic: list[GeodesicDistances],
    shot_keypoints: list[Keypoints],
    params: DetectParams,
) -> Prediction:
    """Points of interest, strongest first, without names: ids are -1 and all are present. The shots give number and scale only.

    There may be fewer than wanted, or none. `costs` are -strength (the detector's response; for "farthest" the distance from the
    points before), `objective` their sum: not comparable between methods. `method` records what was chosen, as `iss scale 0.7 count 9`.

    Raises ValueError: no keypoint in any shot (unless `count` is given and nothing is calibrated); distances that do not fit the
    candidates; a keypoint beyond the cloud.
    """
    from stages.detectors.calibration import average_count
    from stages.detectors.farthest import farthest

    points = normalize.points.astype(np.float64)
    if len(geodesic.distances) != len(points):
        raise ValueError(f"distances: expected those of {len(points)} candidates, got {len(geodesic.distances)}; re-run geodesic")
    calibrated = params.calibrate and params.method != "farthest"
    counts = [len(keypoints.ids) for keypoints in shot_keypoints]
    if not any(counts) and (calibrated or params.count is None):
        raise ValueError("shots: expected at least one annotated keypoint, got none; annotate the shots, or draw others")
    scale, count = 1.0, params.count or average_count(counts)
    if calibrated:
        shots = [
            _shot(f"shot {i}", *shot) for i, shot in enumerate(zip(shot_normalize, shot_geodesic, shot_keypoints, strict=True))
        ]
        choice = _calibrated(tuple(shots), params)
        scale, count = choice.scale, choice.count
    chosen, strength = farthest(geodesic.distances, count) if params.method == "farthest" else _ranked(points, scale, params)
    chosen, strength = chosen[:count], strength[:count]
    return Prediction(
        ids=np.full(len(chosen), -1, np.int32),
        points=chosen.astype(np.int32),
        positions=normalize.points[chosen],
        present=np.ones(len(chosen), bool),
        costs=-strength.astype(np.float32),
        objective=-float(strength.sum()),
        method=f"{params.method} count {count}" if params.method == "farthest" else f"{params.method} scale {scale:g} count {count}",
        shots=[str(i) for i in range(len(shot_normalize))],
    )


@lru_cache(maxsize=16)
def _calibrated(shots: tuple[Shot, ...], params: DetectParams) -> Choice:
    """The choice on these shots. Remembered by their bytes, since all targets of a draw have the same shots: without that,
    calibration would take nine tenths of the time."""
    from stages.detectors.calibration import AnnotatedShot, calibrate

    def annotated(points: bytes, distances: bytes) -> AnnotatedShot:
        places = np.frombuffer(points, np.float32).reshape(-1, 3).astype(np.float64)
        return AnnotatedShot(places, np.frombuffer(distances, np.float16).reshape(len(places), -1))

    def rank(points: np.ndarray, scale: float) -> np.ndarray:
        return _ranked(points, scale, params)[0]

    return calibrate([annotated(*shot) for shot in shots], rank, params.scales, params.threshold, params.count)


def _ranked(points: np.ndarray, scale: float, params: DetectParams) -> tuple[np.ndarray, np.ndarray]:
    """A method's points with all its lengths multiplied by `scale`, strongest first, and their responses."""
    from stages.detectors.neighbourhoods import strongest

    if params.method == "iss":
        from stages.detectors.iss import iss

        response = iss(points, scale * params.iss_salient_radius, params.iss_gamma_21, params.iss_gamma_32, params.iss_min_neighbors)
        chosen = strongest(points, response, scale * params.iss_non_max_radius)
    elif params.method == "harris":
        from stages.detectors.harris3d import harris3d

        response = harris3d(points, scale * params.harris_radius, params.harris_k)
        chosen = strongest(points, response, scale * params.harris_separation)[: int(np.ceil(params.harris_fraction * len(points)))]
    else:
        from stages.detectors.sift3d import sift3d

        least = scale * params.sift_min_scale
        response = sift3d(points, least, params.sift_octaves, params.sift_scales_per_octave, params.sift_min_contrast)
        chosen = strongest(points, response, least)  # one point may be an extremum at several scales, next to another
    return chosen, response[chosen]


def _shot(name: str, shape: NormalizedShape, geodesic: GeodesicDistances, keypoints: Keypoints) -> Shot:
    from stages.geometry.keypoints import keypoint_candidates

    if len(geodesic.distances) != len(shape.points):
        raise ValueError(f"{name}: expected distances of {len(shape.points)} candidates, got {len(geodesic.distances)}; re-run geodesic")
    at = keypoint_candidates(keypoints, shape, name)
    return shape.points.tobytes(), geodesic.distances[:, at].tobytes()
