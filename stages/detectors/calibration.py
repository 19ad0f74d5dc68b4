"""Few-shot calibration: the scale and the number of points with which a detector does best on the annotated shots
themselves."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from b23d.schemas.features import GeodesicDistances
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.shape import NormalizedShape
from b23d.stages.geometry.keypoints import keypoint_candidates
from b23d.stages.solvers.shots import check_fit

MOST = 3
"""Numbers up to this many times the average of the shots are tried."""


@dataclass(frozen=True)
class AnnotatedShot:
    """A shot: its candidates (n, 3) float64, and their distances from its g annotated keypoints (n, g), both in the
    unit frame."""

    points: np.ndarray
    distances: np.ndarray


@dataclass(frozen=True)
class Choice:
    scale: float
    count: int
    iou: float
    """On the shots."""


def average_count(annotated: Sequence[int]) -> int:
    """Mean number of keypoints of the shots, rounded (halves up), at least 1."""
    return max(1, int(np.floor(np.mean(annotated) + 0.5)))


def annotated_shot(
    name: str, shape: NormalizedShape, geodesic: GeodesicDistances, keypoints: Keypoints
) -> AnnotatedShot:
    """A shot as calibration sees it. Raises ValueError: distances that do not fit the candidates, a keypoint beyond the
    cloud."""
    check_fit(name, shape, distances=geodesic)
    at = keypoint_candidates(keypoints, shape, name)
    return AnnotatedShot(shape.points.astype(np.float64), geodesic.distances[:, at])


def choose(
    shots: Sequence[AnnotatedShot],
    rank: Callable[[np.ndarray, float], np.ndarray],
    scales: Sequence[float],
    threshold: float,
    count: int | None = None,
) -> Choice:
    """The scale and count of the largest label-agnostic IoU over the shots together; `count` fixes the count.

    rank(points, scale): a detector's points, strongest first. Of equally good choices, the count nearest to the shots'
    average, then the scale nearest to 1. Deterministic. What is chosen is fitted to the shots, so its IoU there is
    higher than on targets.
    """
    average = average_count([shot.distances.shape[1] for shot in shots])
    counts = np.arange(1, MOST * average + 1) if count is None else np.array([count])
    choices = []
    for scale in scales:
        hits = [shot.distances[rank(shot.points, scale)] <= threshold for shot in shots]
        ious = _ious(hits, counts)
        choices += [Choice(scale, int(k), float(iou)) for k, iou in zip(counts, ious, strict=True)]

    def merit(choice: Choice) -> tuple[float, ...]:
        surplus, octaves = abs(choice.count - average), abs(np.log(choice.scale))
        return round(choice.iou, 9), -surplus, -octaves, -choice.scale

    return max(choices, key=merit)


def _ious(hits: Sequence[np.ndarray], counts: np.ndarray) -> npt.NDArray[np.float64]:
    """Label-agnostic IoU of the first k points of every ranking, all shots together, for every k of `counts`: keypoints
    found over keypoints annotated and points that hit none.

    hits: one (m, g) bool a shot, whether its m points, strongest first, hit its g keypoints. A ranking shorter than k
    counts with all that it has.
    """
    found, wrong = np.zeros(len(counts)), np.zeros(len(counts))
    annotated = sum(hit.shape[1] for hit in hits)
    for hit in hits:
        if not len(hit):
            continue
        last = np.minimum(counts, len(hit)) - 1
        found_so_far = np.logical_or.accumulate(hit, axis=0).sum(axis=1)
        wrong_so_far = np.cumsum(~hit.any(axis=1))
        found += found_so_far[last]
        wrong += wrong_so_far[last]
    return found / np.maximum(annotated + wrong, 1)
