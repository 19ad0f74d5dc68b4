"""A shape with what is known of its candidates, and a shot: such a shape with its keypoints. Whatever learns from shots
takes these, put together and checked in one place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.wording import counted
from b23d.stages.geometry.keypoints import keypoint_candidates


@dataclass(frozen=True)
class KnownShape:
    """A shape whose features and distances are known to fit its n candidates."""

    name: str
    """For messages: "the target", "shot 2"."""
    shape: NormalizedShape
    features: PointFeatures
    distances: GeodesicDistances


@dataclass(frozen=True)
class Shot(KnownShape):
    """An annotated shape with g keypoints; g may be 0."""

    index: int
    """Its place among the shots of the draw."""
    keypoints: Keypoints
    at: np.ndarray
    """(g,) int64, the candidate of each keypoint."""


def described(name: str, shape: NormalizedShape, features: PointFeatures, distances: GeodesicDistances) -> KnownShape:
    """Raises ValueError, naming the shape, as `check_fit`."""
    check_fit(name, shape, features, distances)
    return KnownShape(name, shape, features, distances)


def labelled(
    shapes: Sequence[NormalizedShape],
    features: Sequence[PointFeatures],
    distances: Sequence[GeodesicDistances],
    keypoints: Sequence[Keypoints],
) -> list[Shot]:
    """The shots that a stage is given as one list of each kind, in their order.

    Raises ValueError: no keypoint in any of them; features or distances that do not fit the candidates or are not
    finite; features of different encoders; a keypoint beyond the cloud.
    """
    shots = []
    for i, (shape, feature, distance, keypoint) in enumerate(zip(shapes, features, distances, keypoints, strict=True)):
        name = f"shot {i}"
        check_fit(name, shape, feature, distance)
        at = keypoint_candidates(keypoint, shape, name) if len(keypoint.ids) else np.zeros(0, np.int64)
        shots.append(Shot(name, shape, feature, distance, i, keypoint, at))
    if not any(len(shot.at) for shot in shots):
        raise ValueError(
            f"shots: expected at least one keypoint, got none in {counted(len(shots), 'shot')}; "
            "annotate the shots, or draw others"
        )
    channels = {shot.name: shot.features.features.shape[1] for shot in shots}
    if len(set(channels.values())) > 1:
        raise ValueError(
            f"shots: expected features with as many channels in every shot, got {channels}; use one encoder for all"
        )
    return shots


def check_fit(
    name: str,
    shape: NormalizedShape,
    features: PointFeatures | None = None,
    distances: GeodesicDistances | None = None,
) -> None:
    """Raise ValueError, naming the shape, where what is given of features and distances is not of the shape's
    candidates, or features are not finite."""
    given = {}
    if features is not None:
        given["features", "reweight"] = len(features.features)
    if distances is not None:
        given["distances", "geodesic"] = len(distances.distances)
    n = len(shape.points)
    if any(length != n for length in given.values()):
        what, stages = (" and ".join(names) for names in zip(*given, strict=True))
        got = " and ".join(map(str, given.values()))
        raise ValueError(f"{name}: expected {what} of its {n} candidates, got {got}; re-run {stages}")
    if features is not None and not np.isfinite(features.features).all():
        raise ValueError(
            f"{name}: expected finite features, got NaN or infinity ({features.descriptor}); check the descriptor"
        )
