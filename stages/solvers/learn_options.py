"""What `learn` can be told: all that concerns the shots alone, whatever is then searched for on targets, and how."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from b23d.schemas.params import Params, When
from b23d.schemas.shot_model import Combine, DistanceScale, FeatureScale, Mask


class Deformation(Params):
    """How far keypoints are expected from their mean places: a Gaussian process on them, for each axis."""

    affine_sd: float = Field(0.05, ge=0)
    """Standard deviation of affine deviations from the mean place, in box sides."""
    quadratic_sd: float = Field(0.03, ge=0)
    """Of quadratic ones."""
    smooth_sd: float = Field(0.03, ge=0)
    """Of smooth ones, alike for keypoints that are near each other."""
    smooth_length: float = Field(0.35, gt=0)
    """How near that is, in box sides."""
    independent_sd: float = Field(0.1, gt=0)
    """Of each keypoint's own."""
    worth: float = Field(2.0, gt=0)
    """Deviations of shots, one an axis, that this prior counts as beside what the shots' own teach (an inverse Wishart
    distribution)."""


class Templates(Params):
    """What the paper's objective asks of a target, L = ‖F[c] − F_kp‖ + α ‖(D[c, c] − D_kp) ∘ M‖: F_kp, D_kp and M, of
    which "nearest" and "hungarian" use F_kp alone."""

    features: FeatureScale = "centred-unit"
    """Scale of the features, each shape by itself. "raw": as extracted (the paper). "centred": less the shape's mean.
    "centred-unit": then each point's feature to length 1. "standardised": every channel to mean 0 and variance 1 /
    channels."""
    source_features: Literal["cloud", "keypoints"] = "cloud"
    """Features of the shots' keypoints (DIFFERENCES.md, row 7): "cloud" takes them from the whole shot's smoothed
    features; "keypoints" smooths them among the shot's keypoints only, as the published code does. Whole-shape
    smoothing is `reweight`'s: set its σ to 0 to have this one alone."""
    source_sigma: Annotated[float, When(source_features="keypoints")] = Field(default=0.01, gt=0)
    """σ of that smoothing, in units of the shot's largest distance."""
    combine: Combine = "mean"
    """Several shots (DIFFERENCES.md, row 1): "mean" averages features per id and distances per pair over the shots that
    have them (the paper); "sum_distances" averages features but sums distances (the published code)."""
    distances: DistanceScale = "largest"
    """Unit of the distance term (DIFFERENCES.md, row 9): "largest" divides by each shape's own largest distance (the
    paper); "unit-frame" does not."""
    mask: Mask = "pairs"
    """M (DIFFERENCES.md, row 10). "pairs": pairs of different ids that some shot has both of. "positive": entries of
    D_kp above 0 (the published code), so without pairs that coincide. "whole": as "pairs", and the diagonal (the
    paper's formula), which only the softmax tells apart from "pairs"."""


class LearnParams(Params):
    """Constants of the posterior method's model, chosen on KeypointNet's bathtubs and beds, then left as they are
    for every class; and the template of the paper's objective."""

    components: int = Field(48, ge=1)
    """Principal directions of the shots' features that the discriminant sees."""
    ridge: float = Field(0.3, gt=0)
    """Added to the unit-diagonal covariance of the standardised descriptors (Friedman, regularised discriminant
    analysis, 1989)."""
    radii: tuple[Annotated[float, Field(gt=0)], ...] = Field((0.05, 0.1, 0.2), min_length=1)
    """Of the local geometry, in largest box sides."""
    gate_prior: float = Field(6.0, gt=0)
    """Pseudo-residuals of the frame gate."""
    same_frame: float = Field(6.0, ge=0, le=180)
    """Degrees about the up axis by which two shots' labels may be turned and still count as standing alike, as they do
    where turning them onto each other explains little. Where all do, targets are taken to stand so, too, but for
    those that clearly do not; else shots are turned onto each other, and each target as its evidence says."""
    deformation: Deformation = Deformation()
    template: Templates = Templates()
