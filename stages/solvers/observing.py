"""From labelled shots to their model: what each shows at its keypoints, and what all teach together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from b23d.schemas.shot_model import ShotModel
from b23d.stages.solvers.calibration import NEARNESS, SHARE, fitted
from b23d.stages.solvers.learn_options import LearnParams, Templates
from b23d.stages.solvers.likeness import occupancy
from b23d.stages.solvers.nearness import among
from b23d.stages.solvers.posterior.contrast import contrast, lying_along
from b23d.stages.solvers.posterior.geometry import THINNEST, Prepared, descriptors, prepare
from b23d.stages.solvers.posterior.holding_out import folds, held_out
from b23d.stages.solvers.posterior.learning import (
    basis_of,
    deformation_covariance,
    deviations_of,
    discriminating_covariance,
    frame_gate,
    learned_covariance,
)
from b23d.stages.solvers.posterior.neighbourhoods import POINTS, REACH, around
from b23d.stages.solvers.posterior.registering import SAMPLE, surface_of
from b23d.stages.solvers.posterior.turning import aligned
from b23d.stages.solvers.posterior.weighing import weighed
from b23d.stages.solvers.retrieval import mean_feature
from b23d.stages.solvers.scaling import Relative, relative_distances, scale_features
from b23d.stages.solvers.shots import Shot
from b23d.stages.solvers.template import check_combinable, smooth_among


def observe(shots: Sequence[Shot], params: LearnParams) -> ShotModel:
    """The model of the shots, at least one of which has a keypoint.

    Raises ValueError: several shots of which no two share an id.
    """
    check_combinable([shot.keypoints.ids for shot in shots])
    ids = np.unique(np.concatenate([shot.keypoints.ids for shot in shots])).astype(np.int32)
    rows = [np.searchsorted(ids, shot.keypoints.ids) for shot in shots]
    has = np.zeros((len(shots), len(ids)), bool)
    for row, own in zip(has, rows, strict=True):
        row[own] = True
    tested = folds(has)
    prepared, keypoint_features = [], []
    between, largest = np.zeros((len(shots), len(ids), len(ids)), np.float32), np.zeros(len(shots), np.float32)
    for place, (shot, own) in enumerate(zip(shots, rows, strict=True)):
        lengths = relative_distances(shot.distances.distances)
        one = _prepared(shot, lengths, params)
        between[place][np.ix_(own, own)], largest[place] = _between(lengths, shot.at), lengths.largest
        keypoint_features.append(_features(shot, one.features, lengths, params.template))
        prepared.append(one if place in tested else replace(one, distances=one.distances[:0]))  # they are what is large
    known = np.array([len(shot.at) > 0 for shot in shots])  # the others teach nothing, and are turned to nothing
    turns = np.zeros(len(shots))
    standing, turns[known] = aligned([prepared[i] for i in np.flatnonzero(known)], params.same_frame)
    for i, shape in zip(np.flatnonzero(known), standing, strict=True):
        prepared[i] = shape
    basis = basis_of(standing, params)
    at = [shot.at for shot in shots]

    def gather(values: Sequence[np.ndarray]) -> np.ndarray:
        """(s, k, …) float32 of values (g, …) of each shot's keypoints."""
        found = np.zeros((*has.shape, *values[0].shape[1:]), np.float32)
        for one, own, value in zip(found, rows, values, strict=True):
            one[own] = value
        return found

    places = gather([one.box[points] for one, points in zip(prepared, at, strict=True)])
    mean_places = places.sum(0, dtype=np.float64) / has.sum(0)[:, None]
    along = lying_along(standing)
    contrasts = [contrast(one, basis.basis, basis.mean, basis.scale, along) for one in prepared]
    gate = frame_gate(places[known].astype(np.float64), has[known], params)
    occupancies = np.stack([occupancy(one.position) for one in prepared])
    looks = np.stack([mean_feature(shot.features) for shot in shots])
    near = among(known, occupancies, looks)
    sides = np.stack([one.sides for one in prepared])
    moved = deviations_of(has, places.astype(np.float64), near) * np.maximum(sides, THINNEST)[:, None]
    shifts = gather([one.shift[points] for one, points in zip(prepared, at, strict=True)])
    shifted = deviations_of(has, shifts.astype(np.float64), near)
    prior = deformation_covariance(mean_places, params.deformation) * gate
    described = gather(
        [
            (descriptors(one, basis.basis, points) - basis.mean) / basis.scale
            for one, points in zip(prepared, at, strict=True)
        ]
    )
    spread = min(SAMPLE, *(len(one.position) for one in prepared))
    nearby = [around(one, points, basis.basis, REACH, POINTS) for one, points in zip(prepared, at, strict=True)]
    surfaces = [surface_of(one, basis.basis, spread) for one in prepared]
    tokens = [token for shot in shots if (token := shot.features.class_token) is not None]
    observed: dict[str, Any] = {
        "shots": [str(shot.index) for shot in shots],
        "ids": ids,
        "has": has,
        "deviations": learned_covariance(moved, prior, params.deformation.worth),
        "gate": gate,
        "shift_squares": np.nansum(shifted**2, axis=0),
        "deviating": np.isfinite(shifted[..., 0]).sum(0).astype(np.int32),
        "places": places,
        "shifts": shifts,
        "descriptors": described,
        "distances": between,
        "features": gather(keypoint_features),
        "turns": turns,
        "sides": sides,
        "largest": largest,
        "occupancy": occupancies,
        "along": along,
        "contrasts": np.stack(contrasts),
        "surface": np.stack([one.box for one in surfaces]),
        "surface_looks": np.stack([one.looks for one in surfaces]),
        "around": gather([one.places for one in nearby]),
        "around_looks": gather([one.looks for one in nearby]).astype(np.float16),
        "class_tokens": np.stack(tokens) if len(tokens) == len(shots) else None,
        "mean_features": looks,
        "basis": basis.basis,
        "mean": basis.mean,
        "scale": basis.scale,
        "covariance": discriminating_covariance(basis.covariance, described, has)
        + params.ridge * np.eye(len(basis.mean)),
        "radii": params.radii,
        "feature_scale": params.template.features,
        "distance_scale": params.template.distances,
        "combine": params.template.combine,
        "mask": params.template.mask,
        "descriptor": shots[0].features.descriptor,
    }
    return _summed_up(observed, prepared, tested)


def _summed_up(observed: dict[str, Any], shots: Sequence[Prepared], tested: np.ndarray) -> ShotModel:
    """With what the observations come to where every shot counts alike, for people to look at, and with what they say
    of each other."""
    (s, k), d = observed["has"].shape, len(observed["mean"])
    nothing = {
        "held_out_sure": np.full((s, k), np.nan, np.float32),
        "held_out_near": np.zeros((s, k), bool),
        "sureness": (0.0, 1.0),
        "keypoint": np.zeros(d, np.float32),
        "identity": np.zeros((k, d), np.float32),
        "mean_places": np.zeros((k, 3), np.float32),
        "mean_distances": np.zeros((k, k), np.float32),
    }
    model = ShotModel(**observed, **nothing)
    all_alike = weighed(model, np.ones(s))
    sure, near = held_out(model, shots, tested)
    said = np.isfinite(sure)
    sureness = fitted(sure[said], near[said], NEARNESS, weight=SHARE)
    return ShotModel(
        **observed,
        keypoint=all_alike.keypoint.astype(np.float32),
        identity=all_alike.identity.astype(np.float32),
        mean_places=all_alike.places.astype(np.float32),
        mean_distances=all_alike.distances.astype(np.float32),
        held_out_sure=sure,
        held_out_near=near,
        sureness=(sureness.offset, sureness.slope),
    )


def _prepared(shot: Shot, distances: Relative, params: LearnParams) -> Prepared:
    features = scale_features(shot.features.features, "centred-unit", shot.features.observed)
    return prepare(shot.shape.points, features, distances, params.radii, shot.keypoints.ids, shot.at)


def _features(shot: Shot, centred: np.ndarray, distances: Relative, template: Templates) -> np.ndarray:
    """(g, channel) at the shot's keypoints, in the template's scale; centred (n, channel) is that of "centred-unit"."""
    if template.features != "centred-unit":
        centred = scale_features(shot.features.features, template.features, shot.features.observed)
    own = centred[shot.at]
    if template.source_features == "keypoints" and len(shot.at):
        own = smooth_among(own, _between(distances, shot.at), template.source_sigma)
    return own


def _between(distances: Relative, at: np.ndarray) -> np.ndarray:
    """(g, g) between candidates, in the shape's largest; +inf where no path joins two."""
    found = distances.relative[np.ix_(at, at)]
    if distances.unreachable is not None:
        found[distances.unreachable[np.ix_(at, at)]] = np.inf
    return found
