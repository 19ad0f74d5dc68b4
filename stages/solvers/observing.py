"""From labelled shots to their model: what each shows at its keypoints, and what all teach together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from b23d.schemas.shot_model import ShotModel
from b23d.stages.solvers.calibration import NEARNESS, SHARE, fitted
from b23d.stages.solvers.learn_options import LearnParams, Templates
from b23d.stages.solvers.likeness import occupancy
from b23d.stages.solvers.nearness import among
from b23d.stages.solvers.posterior.geometry import THINNEST, Prepared, descriptors, prepare
from b23d.stages.solvers.posterior.holding_out import folds, held_out
from b23d.stages.solvers.posterior.learning import (
    basis_of,
    deformation_covariance,
    deviations_of,
    frame_gate,
    learned_covariance,
)
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
    distances = [relative_distances(shot.distances.distances) for shot in shots]
    prepared = [_prepared(shot, lengths, params) for shot, lengths in zip(shots, distances, strict=True)]
    known = np.array([len(shot.at) > 0 for shot in shots])  # the others teach nothing, and are turned to nothing
    turns = np.zeros(len(shots))
    standing, turns[known] = aligned([prepared[i] for i in np.flatnonzero(known)], params.same_frame)
    for i, shape in zip(np.flatnonzero(known), standing, strict=True):
        prepared[i] = shape
    basis = basis_of(standing, params)
    ids = np.unique(np.concatenate([shot.keypoints.ids for shot in shots])).astype(np.int32)
    at = [shot.at for shot in shots]
    rows = [np.searchsorted(ids, shot.keypoints.ids) for shot in shots]
    has = np.zeros((len(shots), len(ids)), bool)
    for row, own in zip(has, rows, strict=True):
        row[own] = True

    def gather(values: Sequence[np.ndarray]) -> np.ndarray:
        """(s, k, d) float32 of values (g, d) of each shot's keypoints."""
        found = np.zeros((*has.shape, values[0].shape[1]), np.float32)
        for one, own, value in zip(found, rows, values, strict=True):
            one[own] = value
        return found

    between = np.zeros((len(shots), len(ids), len(ids)), np.float32)
    for one, own, lengths, points in zip(between, rows, distances, at, strict=True):
        one[np.ix_(own, own)] = _between(lengths, points)
    places = gather([one.box[points] for one, points in zip(prepared, at, strict=True)])
    mean_places = places.sum(0, dtype=np.float64) / has.sum(0)[:, None]
    gate = frame_gate(places[known].astype(np.float64), has[known], params)
    occupancies = np.stack([occupancy(one.position) for one in prepared])
    looks = np.stack([mean_feature(shot.features) for shot in shots])
    near = among(known, occupancies, looks)
    sides = np.stack([one.sides for one in prepared])
    moved = deviations_of(has, places.astype(np.float64), near) * np.maximum(sides, THINNEST)[:, None]
    shifts = gather([one.shift[points] for one, points in zip(prepared, at, strict=True)])
    shifted = deviations_of(has, shifts.astype(np.float64), near)
    prior = deformation_covariance(mean_places, params.deformation) * gate
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
        "descriptors": gather(
            [
                (descriptors(one, basis.basis)[points] - basis.mean) / basis.scale
                for one, points in zip(prepared, at, strict=True)
            ]
        ),
        "distances": between,
        "features": gather(
            [_features(shot, lengths, params.template) for shot, lengths in zip(shots, distances, strict=True)]
        ),
        "turns": turns,
        "sides": sides,
        "largest": np.array([lengths.largest for lengths in distances], np.float32),
        "occupancy": occupancies,
        "class_tokens": np.stack(tokens) if len(tokens) == len(shots) else None,
        "mean_features": looks,
        "basis": basis.basis,
        "mean": basis.mean,
        "scale": basis.scale,
        "covariance": basis.covariance,
        "radii": params.radii,
        "feature_scale": params.template.features,
        "distance_scale": params.template.distances,
        "combine": params.template.combine,
        "mask": params.template.mask,
        "descriptor": shots[0].features.descriptor,
    }
    return _summed_up(observed, prepared)


def _summed_up(observed: dict[str, Any], shots: Sequence[Prepared]) -> ShotModel:
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
    sure, near = held_out(model, shots, folds(model.has))
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


def _features(shot: Shot, distances: Relative, template: Templates) -> np.ndarray:
    """(g, channel) at the shot's keypoints, in the template's scale."""
    own = scale_features(shot.features.features, template.features, shot.features.observed)[shot.at]
    if template.source_features == "keypoints" and len(shot.at):
        own = smooth_among(own, _between(distances, shot.at), template.source_sigma)
    return own


def _between(distances: Relative, at: np.ndarray) -> np.ndarray:
    """(g, g) between candidates, in the shape's largest; +inf where no path joins two."""
    found = distances.relative[np.ix_(at, at)]
    if distances.unreachable is not None:
        found[distances.unreachable[np.ix_(at, at)]] = np.inf
    return found
