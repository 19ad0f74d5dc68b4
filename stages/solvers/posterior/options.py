"""Constants of the posterior method. Chosen on KeypointNet's bathtubs alone, then left as they are for every class."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from b23d.schemas.params import Params, When


class PosteriorParams(Params):
    components: int = Field(48, ge=1)
    """Principal directions of the shots' features that the discriminant sees."""
    ridge: float = Field(0.3, gt=0)
    """Added to the unit-diagonal covariance of the standardised descriptors (Friedman, regularised discriminant
    analysis, 1989)."""
    radii: tuple[Annotated[float, Field(gt=0)], ...] = Field((0.05, 0.1, 0.2), min_length=1)
    """Of the local geometry, in largest box sides."""
    keypoint_weight: float = 1.5
    """Weight of "is a keypoint at all", pooled over ids: three shots have some forty examples of it."""
    identity_weight: float = 0.5
    """Weight of "is this keypoint rather than another"."""
    shift_sd: float = Field(0.2, gt=0)
    """Standard deviation of the mean-shift vectors, in radii."""
    affine_sd: float = Field(0.05, ge=0)
    """Deformation prior: standard deviation of affine deviations from the mean place, in box sides."""
    quadratic_sd: float = Field(0.03, ge=0)
    """Of quadratic ones."""
    smooth_sd: float = Field(0.03, ge=0)
    """Of smooth ones, alike for keypoints that are near each other."""
    smooth_length: float = Field(0.35, gt=0)
    """How near that is, in box sides."""
    independent_sd: float = Field(0.1, gt=0)
    """Of each keypoint's own."""
    distance_weight: float = Field(2.0, ge=0)
    """Weight of the geodesic distances between keypoints."""
    distance_sd: float = Field(0.05, gt=0)
    """Of distances, in the shape's largest."""
    gate_prior: float = Field(6.0, gt=0)
    """Pseudo-residuals of the frame gate."""
    same_frame: float = Field(20.0, ge=0, le=180)
    """Degrees about the up axis by which two shots' labels may be turned and still count as standing alike. Where all
    do, targets are taken to stand so, too; else shots are turned onto each other, and each target as its evidence
    says."""
    turns: int = Field(24, ge=1)
    """Turns of a target that are tried."""
    turn_concentration: float = Field(20.0, gt=0)
    """Of the von Mises prior that a target stands as a shot does; 20 is a standard deviation of 13°."""
    sides_sd: float = Field(0.25, gt=0)
    """Standard deviation of the logarithms of the box's sides, for judging turns."""
    temper: float = Field(2.0, ge=1)
    """Divides the evidence for a turn: keypoints of one shape are less independent than the bound has it."""
    iterations: int = Field(6, ge=1)
    """Of the mean field, over all keypoints in turn."""
    hit_radius: float = Field(0.08, gt=0)
    """How near counts as a hit when a point is chosen, in largest box sides."""
    presence: Literal["evidence", "majority", "all"] = "evidence"
    """Which ids to predict (DIFFERENCES.md, row 22): "all" that any shot has (the paper); "majority": those of more
    than half of the shots; "evidence": groups of ids that are expected to be hit."""
    present: Annotated[float, When(presence="evidence")] = Field(0.5, ge=0, le=1)
    """Least mean expected hit for a group of ids to be judged present."""
