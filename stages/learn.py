"""learn: what the shots of a draw show and teach, once for all its targets."""

from __future__ import annotations

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.shot_model import ShotModel
from b23d.stages.solvers.learn_options import LearnParams


@stage(version=9, hints=Hints(memory_gb=1.0))
def learn(
    shot_normalize: list[NormalizedShape],
    shot_reweight: list[PointFeatures],
    shot_geodesic: list[GeodesicDistances],
    shot_keypoints: list[Keypoints],
    params: LearnParams,
) -> ShotModel:
    """The shots' model: it sees the shots only, so that one serves all targets of a draw, whatever method finds them.

    Raises ValueError: no keypoint in any shot; several shots of which no two share an id; features of different
    encoders; features or distances that do not fit the candidates or are not finite; a keypoint beyond the cloud.
    """
    from b23d.stages.solvers.observing import observe
    from b23d.stages.solvers.shots import labelled

    return observe(labelled(shot_normalize, shot_reweight, shot_geodesic, shot_keypoints), params)
