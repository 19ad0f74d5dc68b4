"""annotation: does a shape's annotation lie on it? One rule for shots and targets, meshes and clouds."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.annotation import AnnotationCheck
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.params import Params
from b23d.schemas.shape import NormalizedShape


class AnnotationParams(Params):
    """How far from the surface a keypoint may be, in longest sides of the shape; for a cloud, over its spacing."""

    warn: float = Field(default=0.02, ge=0)
    """Keypoints farther than this are told."""
    refuse: float = Field(default=0.1, ge=0)
    """Annotations with a keypoint farther than this are not used: they are in another unit, frame or order of axes, or
    of another shape. So are those beyond `warn` that such a mistake explains exactly. Keypoints that are meant to lie
    off the surface (joints, centres of openings) need a larger value."""
    together: float = Field(default=0.0125, ge=0)
    """Annotations of three keypoints or more that all lie within this are not used (of two: told): they are too small
    by a unit. So are those within ten times this whose keypoints a unit or frame brings exactly onto the surface;
    others within five times this are told. Keypoints that are meant to lie so near together need a smaller value."""

    @model_validator(mode="after")
    def _told_before_refused(self) -> Self:
        if self.warn > self.refuse:
            raise ValueError(
                f"warn: expected at most refuse, {self.refuse:g}, got {self.warn:g}; "
                "raise stages.annotation.refuse as well"
            )
        return self


@stage(version=2, hints=Hints(memory_gb=0.3), checks="keypoints")
def annotation(normalize: NormalizedShape, keypoints: Keypoints, params: AnnotationParams) -> AnnotationCheck:
    """The keypoints' distances from the surface, and what is odd about them.

    A shape that fails here is neither shot nor scored; it is still predicted. Raises ValueError, naming the worst
    keypoint, its distance and the likely cause: a keypoint off the surface, keypoints all at about one place, a point
    index beyond the cloud or far from the keypoint's own position.
    """
    from b23d.stages.geometry.keypoints import check_annotation

    distances, warnings = check_annotation(keypoints, normalize, params.warn, params.refuse, params.together)
    return AnnotationCheck(ids=keypoints.ids, distances=distances, warnings=warnings)
