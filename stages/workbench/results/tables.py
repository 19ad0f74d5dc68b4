"""Predictions and scores of a whole run as tables, for pandas and whatever reads parquet."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from b23d.pipeline.run import Run
from b23d.schemas.scores import ShapeScore
from b23d.stages.workbench.results.gathering import Attempt, Gathering, ShapeResults
from b23d.stages.workbench.results.matching import iou, keypoint_errors

if TYPE_CHECKING:
    import pandas as pd


def prediction_table(run: Run) -> pd.DataFrame:
    """One row a keypoint, predicted or only annotated, in every draw.

    x, y, z: in the unit frame; `file_…`: in the data set's own; `true_…`: the annotated place of the same id, unit
    frame; `error`: geodesic distance between them in the score's units, of keypoints judged present. NaN where there is
    none.
    """
    return _frame(run, _keypoints)


def score_rows(run: Run) -> pd.DataFrame:
    """One row a shape, draw and threshold: the counts of `ShapeScore` and the shape's own IoU."""
    return _frame(run, _thresholds)


def _frame(run: Run, rows: Any) -> pd.DataFrame:
    import pandas as pd

    gathered = Gathering(run)
    entries = (gathered.entry(shape) for shape in run.shapes)
    return pd.DataFrame(
        [
            {"run": run.name, "class": entry.shape.category, "shape": entry.shape.id, "draw": attempt.draw, **row}
            for entry in entries
            for attempt in entry.attempts
            for row in rows(entry, attempt)
        ]
    )


def _keypoints(entry: ShapeResults, attempt: Attempt) -> Iterator[dict[str, Any]]:
    found, errors = attempt.prediction, keypoint_errors(entry, attempt)
    truth = (
        {} if entry.keypoints is None else dict(zip(entry.keypoints.ids.tolist(), entry.true_positions(), strict=True))
    )
    nowhere = np.full(3, np.nan)
    shape = entry.normalized
    for place, number in enumerate(found.ids.tolist()):
        at = found.positions[place]
        own = shape.to_source(at) if shape is not None else nowhere
        true = truth.get(number, nowhere)
        present = bool(found.present[place])
        yield {
            "id": number,
            "predicted": True,
            "annotated": number in truth,
            "present": present,
            "point": int(found.points[place]),
            **_axes("", at),
            **_axes("file_", own),
            **_axes("true_", true),
            "error": errors.get(number, np.nan) if present else np.nan,
            "cost": float(found.costs[place]),
            "objective": found.objective,
            "method": found.method,
        }
    for number in truth.keys() - set(found.ids.tolist()):
        missed = {
            **_axes("", nowhere),
            **_axes("file_", nowhere),
            **_axes("true_", truth[number]),
            "error": np.nan,
            "cost": np.nan,
        }
        yield {
            "id": number,
            "predicted": False,
            "annotated": True,
            "present": False,
            "point": -1,
            **missed,
            "objective": found.objective,
            "method": found.method,
        }


def _thresholds(entry: ShapeResults, attempt: Attempt) -> Iterator[dict[str, Any]]:
    score = attempt.score
    if not isinstance(score, ShapeScore):
        return
    own = iou(score)
    for place, threshold in enumerate(score.thresholds.tolist()):
        counts = ("true_positives", "false_positives", "false_negatives", "matched")
        named = ("labelled", "symmetric", "either_front")
        yield {
            "threshold": threshold,
            "iou": float(own[place]),
            **{name: int(getattr(score, name)[place]) for name in counts + named},
            "annotated": score.annotated,
            "predicted": score.predicted,
            "common": score.common,
            "ceiling": float(score.ceiling[0] / max(1, score.ceiling[1])),
            "protocol": score.protocol,
        }


def _axes(prefix: str, at: np.ndarray) -> dict[str, float]:
    return {f"{prefix}{axis}": float(value) for axis, value in zip("xyz", at, strict=True)}
