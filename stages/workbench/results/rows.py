"""One line a shape: what the table sorts and filters by."""

from __future__ import annotations

from typing import Any

import numpy as np

from b23d.schemas.predictions import Prediction
from b23d.schemas.scores import ShapeScore
from b23d.stages.workbench.results.gathering import Attempt, ShapeResults

AT = (0.02, 0.05, 0.10)  # thresholds shown in the table


def row(entry: ShapeResults) -> dict[str, Any]:
    """The table's line of a shape: means over its draws; None where a figure does not exist."""
    scores = [attempt.score for attempt in entry.attempts if attempt.score is not None]
    features = entry.features
    return {
        "name": entry.shape.name,
        "id": entry.shape.id,
        "category": entry.shape.category,
        "kind": entry.normalized.kind if entry.normalized is not None else None,
        "points": len(entry.normalized.points) if entry.normalized is not None else None,
        "annotated": len(entry.keypoints.ids) if entry.keypoints is not None else None,
        "predicted": _mean([int(attempt.prediction.present.sum()) for attempt in entry.attempts]),
        "auc": _mean([float(iou(score).mean()) for score in scores]),
        **{f"iou{round(at * 100):02d}": _mean([_at(score, iou(score), at) for score in scores]) for at in AT},
        "pck": _mean([_at(score, score.labelled / score.annotated, AT[-1]) for score in scores if score.annotated]),
        "error": _mean([error for attempt in entry.attempts for error in keypoint_errors(entry, attempt).values()]),
        "unseen": float(1 - features.observed.mean()) if features is not None and len(features.observed) else None,
        "draws": [attempt.draw for attempt in entry.attempts],
        "shot": entry.shot_of,
        "errors": entry.errors,
        "state": "failed" if entry.errors else "waiting" if entry.waiting else "done",
    }


def iou(score: ShapeScore) -> np.ndarray:
    """(t,) intersection over union of one shape, label-agnostic; 0 where there is nothing to find or found."""
    union = score.true_positives + score.false_positives + score.false_negatives
    return np.asarray(score.true_positives / np.maximum(union, 1))


def keypoint_errors(entry: ShapeResults, attempt: Attempt) -> dict[int, float]:
    """Id → geodesic distance of the prediction from the annotated keypoint of the same id, in the score's units."""
    if attempt.score is None or entry.keypoints is None:
        return {}
    present = present_ids(attempt.prediction)
    distances, annotated = attempt.score.distances, entry.keypoints.ids.tolist()
    if distances.shape != (len(present), len(annotated)):
        return {}
    return {
        number: float(distances[i, annotated.index(number)])
        for i, number in enumerate(present)
        if number in annotated and np.isfinite(distances[i, annotated.index(number)])
    }


def present_ids(prediction: Prediction) -> list[int]:
    """Ids judged present, in the order of the score's rows."""
    return [int(number) for number in prediction.ids[prediction.present]]


def _at(score: ShapeScore, values: np.ndarray, threshold: float) -> float | None:
    place = np.flatnonzero(np.isclose(score.thresholds, threshold))
    return float(values[place[0]]) if len(place) else None


def _mean(values: list[Any]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None
