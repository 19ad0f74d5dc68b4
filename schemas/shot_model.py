"""ShotModel: what the shots of one draw show and teach; what `learn` gives and `optimize` uses."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from b23d.schemas.artifact import ArraySpec, Artifact

Combine = Literal["mean", "sum_distances"]
Mask = Literal["pairs", "positive", "whole"]
FeatureScale = Literal["raw", "centred", "centred-unit", "standardised"]
DistanceScale = Literal["largest", "unit-frame"]


class ShotModel(Artifact):
    """Observations at the keypoints of every shot, in one frame and one basis, and statistics of all of them.

    `optimize` may weigh the shots anew for every target: means, discriminants and distances are then taken over the
    observations, `basis`, `mean`, `scale` and `covariance` stay. Whatever a shot lacks is 0 in its observations.

    The *common frame* is the shots' own where they stand alike, else that of one of them; a *box* is a shape's bounding
    box there, centred, its longest side 1.
    """

    shots: list[str]
    """Indices of the shots in the draw, as text."""
    ids: Annotated[np.ndarray, ArraySpec("k", "int32")]
    """Every id that some shot has, sorted."""
    has: Annotated[np.ndarray, ArraySpec("shot k", "bool")]

    keypoint: Annotated[np.ndarray, ArraySpec("descriptor", "float32")]
    """Discriminant "is a keypoint at all" of the standardised descriptors, every shot alike."""
    identity: Annotated[np.ndarray, ArraySpec("k descriptor", "float32")]
    """Discriminants "is this keypoint rather than another", every shot alike."""
    mean_places: Annotated[np.ndarray, ArraySpec("k 3", "float32", unit="sides of the box, −.5 … .5")]
    mean_distances: Annotated[np.ndarray, ArraySpec("k k", "float32", unit="the shape's largest distance")]
    """Between keypoints, over the shots that have both; 0 where none has."""
    deviations: Annotated[np.ndarray, ArraySpec("k k", "float64", unit="squared longest sides of the box")]
    """Covariance, for each axis, of keypoints' deviations from where the shots most like a shape have them: the
    prior's, moved towards that of each shot's from the others."""
    gate: float
    """How many times the shots' disagreement about places exceeds the prior's, which has it in. At least 1."""
    shift_squares: Annotated[np.ndarray, ArraySpec("k shift", "float64")]
    """Summed squared deviations of each shot's mean-shift vectors from those of the others most like it."""
    deviating: Annotated[np.ndarray, ArraySpec("k", "int32")]
    """Over how many shots that have the id, as another does."""

    places: Annotated[np.ndarray, ArraySpec("shot k 3", "float32", unit="sides of the box, −.5 … .5")]
    shifts: Annotated[np.ndarray, ArraySpec("shot k shift", "float32")]
    """Mean-shift vectors, three numbers a radius."""
    descriptors: Annotated[np.ndarray, ArraySpec("shot k descriptor", "float32")]
    """Standardised: components of the feature, then the local geometry."""
    distances: Annotated[np.ndarray, ArraySpec("shot k k", "float32", unit="the shape's largest distance")]
    """+inf where one keypoint cannot be reached from another."""
    features: Annotated[np.ndarray, ArraySpec("shot k channel", "float32")]
    """In `feature_scale`: what the paper's objective compares."""

    turns: Annotated[np.ndarray, ArraySpec("shot", "float64", unit="radians")]
    """By which each shot was turned into the common frame, about the up axis from +z towards +x."""
    sides: Annotated[np.ndarray, ArraySpec("shot 3", "float32", unit="longest side")]
    """Of each shot's box."""
    largest: Annotated[np.ndarray, ArraySpec("shot", "float32", unit="the shot's own unit frame")]
    """Each shot's largest distance."""
    occupancy: Annotated[np.ndarray, ArraySpec("shot cell", "float32")]
    """Share of each shot's candidates in every cell of a grid of 10 × 10 × 10 over the cube that its box lies in."""
    along: float
    """Radians about the up axis, less than a quarter turn, by which the common frame is turned for the shots to lie
    along its axes; `contrasts` are seen so."""
    contrasts: Annotated[np.ndarray, ArraySpec("shot contrast", "float32")]
    """How each shot's surface differs from itself turned half round: per cell of half the box, components of the
    feature, then the same cells' local geometry; each of both of length 0 … 1."""
    surface: Annotated[np.ndarray, ArraySpec("shot point 3", "float32", unit="sides of the box, −.5 … .5")]
    """Points spread over each shot, by which it is laid over a target."""
    surface_looks: Annotated[np.ndarray, ArraySpec("shot point component", "float32")]
    """Components of their features."""
    around: Annotated[np.ndarray, ArraySpec("shot k neighbour 3", "float32", unit="longest side of the box")]
    """Points around each keypoint, from it."""
    around_looks: Annotated[np.ndarray, ArraySpec("shot k neighbour component", "float16")]
    """Components of their features."""
    class_tokens: Annotated[np.ndarray, ArraySpec("shot channel", "float32")] | None = None
    """None where a shot has none."""
    mean_features: Annotated[np.ndarray, ArraySpec("shot channel", "float32")]
    """Of each shot's observed points, as extracted."""

    held_out_sure: Annotated[np.ndarray, ArraySpec("shot k", "float32", unit="0 … 1")]
    """How sure the other shots are of each id on each held-out shot: their posterior's mass around the point that they
    choose. NaN on shots that were not held out, and for ids that no other shot has."""
    held_out_near: Annotated[np.ndarray, ArraySpec("shot k", "bool")]
    """Whether the shot has the id, and it is within .05 of that point along the surface (longest sides of the box)."""
    sureness: tuple[float, float]
    """Offset and slope of the map, on log-odds, from such mass to the probability of being so near: that of development
    classes, moved by what was held out."""

    basis: Annotated[np.ndarray, ArraySpec("channel component", "float32")]
    """Principal directions of the shots' features."""
    mean: Annotated[np.ndarray, ArraySpec("descriptor", "float32")]
    """Of the descriptor over the points of all shots that have keypoints; of over 20,480, over so many of them."""
    scale: Annotated[np.ndarray, ArraySpec("descriptor", "float32")]
    covariance: Annotated[np.ndarray, ArraySpec("descriptor descriptor", "float64")]
    """Of the standardised descriptors over the same points, moved towards that of keypoints' own from shot to shot;
    with the ridge."""

    radii: tuple[float, ...]
    """Of the local geometry, in longest sides of the box."""
    feature_scale: FeatureScale
    distance_scale: DistanceScale
    combine: Combine
    mask: Mask
    descriptor: str
    """What made the features."""
