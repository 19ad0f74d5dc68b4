"""What the 3D view of one shape needs, packed: some 100 kB for 2,048 candidates and a mesh."""

from __future__ import annotations

from typing import Any

import numpy as np

from b23d.schemas.features import PointFeatures
from b23d.schemas.shape import NormalizedShape
from b23d.stages.workbench.pictures.packing import curve_order, pack, pack_places
from b23d.stages.workbench.pictures.painting import LIGHT
from b23d.stages.workbench.pictures.principal import Basis
from b23d.stages.workbench.pictures.surface import pack_surface, point_normals, surface_of
from b23d.stages.workbench.report.distances import pack_distances
from b23d.stages.workbench.results.gathering import Attempt, ShapeResults
from b23d.stages.workbench.results.matching import iou, keypoint_errors

SHOWN = 2048  # candidates a view shows
CHANNELS = 12  # principal components that similarities are taken of


def details(entry: ShapeResults, basis: Basis | None) -> dict[str, Any]:
    """The JSON value that `static/viewer.js` shows. Positions are of the unit frame.

    Of more than 2,048 candidates, farthest-point samples are shown. Raises ValueError where the shape has not been
    normalized, CorruptArtifactError where an artifact is damaged.
    """
    shape = entry.normalized
    if shape is None:
        raise ValueError(f"{entry.shape.name}: expected a normalized shape, got none; run it first")
    chosen = _shown(shape)
    points = shape.points[chosen]
    shade = np.round(255 * (0.45 + 0.55 * np.abs(point_normals(shape)[chosen] @ LIGHT))).astype(np.uint8)
    surface = surface_of(shape)
    return {
        "name": entry.shape.name,
        "category": entry.shape.category,
        "kind": shape.kind,
        "candidates": {"of": len(shape.points), "made": shape.candidates},
        "scale": shape.scale,
        "repairs": {name: count for name, count in shape.repairs.items() if count},
        "points": pack_places(points),
        "indices": pack(chosen.astype(np.int32)),
        "shade": pack(shade),
        "surface": pack_surface(surface) if surface is not None else None,
        **_features(entry.features, basis, len(shape.points), chosen),
        "distances": _distances(entry, chosen, points),
        "truth": _truth(entry),
        "attempts": [_attempt(entry, attempt) for attempt in entry.attempts],
    }


def _shown(shape: NormalizedShape) -> np.ndarray:
    from b23d.stages.geometry.sampling import farthest_points

    chosen = farthest_points(shape.points, SHOWN)
    return np.asarray(chosen[curve_order(shape.points[chosen])])  # neighbours near each other pack small


def _features(features: PointFeatures | None, basis: Basis | None, n: int, chosen: np.ndarray) -> dict[str, Any]:
    if features is None or len(features.features) != n:
        return {"features": None, "colors": None, "counts": None, "observed": None}
    counts = np.minimum(features.counts[chosen], 65535).astype(np.uint16)
    seen = {"counts": pack(counts), "observed": pack(features.observed[chosen])}
    if basis is None:
        return {"features": None, "colors": None, **seen}
    projected = basis.project(features.features[chosen])
    return {"features": pack(directions(projected[:, :CHANNELS])), "colors": pack(basis.colors(projected)), **seen}


def directions(features: np.ndarray) -> np.ndarray:
    """(n, c) int8: each row scaled so that its largest entry is 127; a cosine needs no length."""
    largest = np.maximum(np.abs(features).max(axis=1, keepdims=True, initial=0), 1e-12)
    return np.asarray(np.round(features * (127 / largest)).astype(np.int8))


def _distances(entry: ShapeResults, chosen: np.ndarray, points: np.ndarray) -> dict[str, Any] | None:
    shape, geodesic = entry.normalized, entry.distances
    if shape is None or geodesic is None or len(geodesic.distances) != len(shape.points):
        return None
    return {**pack_distances(geodesic.distances[np.ix_(chosen, chosen)], points), "method": geodesic.method}


def _truth(entry: ShapeResults) -> list[dict[str, Any]]:
    if entry.keypoints is None:
        return []
    return [
        {"id": int(i), "at": _triple(at)} for i, at in zip(entry.keypoints.ids, entry.true_positions(), strict=True)
    ]


def _attempt(entry: ShapeResults, attempt: Attempt) -> dict[str, Any]:
    prediction, score = attempt.prediction, attempt.score
    errors = keypoint_errors(entry, attempt)
    sure = [None] * len(prediction.ids) if prediction.confidence is None else prediction.confidence
    found = zip(
        prediction.ids, prediction.points, prediction.positions, prediction.present, sure, prediction.costs, strict=True
    )
    keypoints = [
        {
            "id": int(i),
            "point": int(point),
            "at": _triple(at),
            "present": bool(here),
            "confidence": None if confidence is None else _rounded(confidence),
            "cost": _rounded(cost),
            "error": errors.get(int(i)),
        }
        for i, point, at, here, confidence, cost in found
    ]
    return {
        "draw": attempt.draw,
        "method": prediction.method,
        "objective": _rounded(prediction.objective),
        "ofClass": None if prediction.class_confidence is None else _rounded(prediction.class_confidence),
        "keypoints": keypoints,
        "iou": None if score is None else [_rounded(value) for value in iou(score)],
    }


def _triple(at: np.ndarray) -> list[float]:
    return [round(float(x), 5) for x in at]


def _rounded(value: Any) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None
