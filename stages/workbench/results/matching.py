"""How a prediction meets a shape's annotation: the shape's own IoU, and the error of every id."""

from __future__ import annotations

import numpy as np

from b23d.schemas.predictions import Prediction
from b23d.schemas.scores import ShapeScore
from b23d.stages.workbench.results.gathering import Attempt, ShapeResults


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
