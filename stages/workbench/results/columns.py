"""The columns of the report's table of shapes. One entry here is all that a new column needs: the table shows it, sorts
by it, and leaves it out where no shape has a value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from b23d.schemas.scores import ShapeScore
from b23d.stages.workbench.results.gathering import Attempt, ShapeResults
from b23d.stages.workbench.results.matching import iou, keypoint_errors

Shown = Literal["name", "draws", "figure2", "figure3", "percent", "whole"]
"""How `static/table.js` writes a value."""


@dataclass(frozen=True)
class Column:
    """A figure of a shape that the table can be sorted by."""

    key: str
    label: str
    means: str
    """The tip of the column's title."""
    value: Callable[[ShapeResults], Any]
    """None where a shape has no such figure."""
    shown: Shown
    bar: bool = False
    """A bar of the value's length (0 … 1) behind it."""


def _auc(found: ShapeResults) -> float | None:
    return mean(float(iou(score).mean()) for score in _scores(found))


def _iou_at(threshold: float) -> Callable[[ShapeResults], float | None]:
    return lambda found: mean(_at(score, iou(score), threshold) for score in _scores(found))


def _pck(found: ShapeResults) -> float | None:
    return mean(_at(score, score.labelled / score.annotated, 0.10) for score in _scores(found) if score.annotated)


def _symmetric(found: ShapeResults) -> float | None:
    return mean(_at(score, score.symmetric / score.annotated, 0.10) for score in _scores(found) if score.annotated)


def _error(found: ShapeResults) -> float | None:
    return mean(error for attempt in found.attempts for error in keypoint_errors(found, attempt).values())


def _sure_of_up(found: ShapeResults) -> float | None:
    return None if found.orientation is None else found.orientation.probability


def _confidence(found: ShapeResults) -> float | None:
    return mean(confidence_of(attempt) for attempt in found.attempts)


def confidence_of(attempt: Attempt) -> float | None:
    """Mean over the keypoints judged present; None where the method tells none, or all are judged absent."""
    prediction = attempt.prediction
    if prediction.confidence is None or not prediction.present.any():
        return None
    return float(prediction.confidence[prediction.present].mean())


STRANGE = 0.5
"""A shape that is less probably of its class is flagged."""


def _of_class(found: ShapeResults) -> float | None:
    return mean(attempt.prediction.class_confidence for attempt in found.attempts)


def _front(found: ShapeResults) -> float | None:
    return mean(attempt.prediction.front_margin for attempt in found.attempts)


def _predicted(found: ShapeResults) -> float | None:
    return mean(int(attempt.prediction.present.sum()) for attempt in found.attempts)


def _annotated(found: ShapeResults) -> int | None:
    return None if found.keypoints is None else len(found.keypoints.ids)


def _unseen(found: ShapeResults) -> float | None:
    features = found.features
    return None if features is None or not len(features.observed) else float(1 - features.observed.mean())


OWN = "the shape's own, mean over draws"
COLUMNS = (
    Column("name", "shape", "class and id", lambda found: found.shape.name, "name"),
    Column(
        "auc", "AUC", "mean of the shape's own IoU over thresholds 0 … .10, and over draws", _auc, "figure3", bar=True
    ),
    Column("iou02", "IoU .02", OWN, _iou_at(0.02), "figure2"),
    Column("iou05", "IoU .05", OWN, _iou_at(0.05), "figure2"),
    Column("iou10", "IoU .10", OWN, _iou_at(0.10), "figure2"),
    Column("pck", "PCK .10", "annotated keypoints whose own id is predicted within .10", _pck, "figure2"),
    Column(
        "symmetric",
        "sym. PCK .10",
        "the same after the best exchange of ids that a symmetry of the shape permits",
        _symmetric,
        "figure2",
    ),
    Column(
        "error",
        "error",
        "mean geodesic distance between predicted and annotated keypoints of one id, in the score's units",
        _error,
        "figure3",
    ),
    Column(
        "confidence",
        "confidence",
        "how sure the method is of the keypoints judged present, presuming that the shape is of its class: mean over "
        "keypoints and draws; needs no annotation, posterior and trained heads tell it",
        _confidence,
        "figure2",
        bar=True,
    ),
    Column(
        "up",
        "sure of up",
        "probability of the axis that was found to point up, where dataset.up leaves it to be found",
        _sure_of_up,
        "figure2",
        bar=True,
    ),
    Column(
        "front",
        "front",
        "nats of evidence by which the turn that was found beats the next best, mean over draws: a tie below 10 or so",
        _front,
        "figure2",
    ),
    Column(
        "of_class",
        "of class",
        "probability that the shape is of the shots' class at all: below .5 it may be a stranger in its folder, and "
        "its confidence means little; one shot cannot tell",
        _of_class,
        "figure2",
        bar=True,
    ),
    Column("annotated", "annotated", "annotated keypoints", _annotated, "whole"),
    Column("predicted", "predicted", "keypoints judged present, mean over draws", _predicted, "whole"),
    Column("unseen", "unseen", "candidates that no view sees", _unseen, "percent"),
    Column(
        "draws",
        "draws",
        "draws of shots in which this shape is a target",
        lambda found: [attempt.draw for attempt in found.attempts],
        "draws",
    ),
)


def shown_columns(rows: Iterable[dict[str, Any]]) -> list[Column]:
    """The columns that some row has a value in."""
    rows = list(rows)
    return [column for column in COLUMNS if any(row[column.key] not in (None, []) for row in rows)]


def mean(values: Iterable[float | None]) -> float | None:
    """Over the known ones; None where there is none."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _scores(found: ShapeResults) -> list[ShapeScore]:
    return [attempt.score for attempt in found.attempts if attempt.score is not None]


def _at(score: ShapeScore, values: np.ndarray, threshold: float) -> float | None:
    place = np.flatnonzero(np.isclose(score.thresholds, threshold))
    return float(values[place[0]]) if len(place) else None
