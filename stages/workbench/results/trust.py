"""Which predictions of a shape were right, beside how sure the method was of them."""

from __future__ import annotations

from b23d.stages.geometry.keypoints import keypoint_candidates
from b23d.stages.workbench.results.gathering import ShapeResults

NEAR = 0.05
"""Along the surface, of a shape of longest side 1: what `Prediction.confidence` speaks of."""


def judged(found: ShapeResults) -> list[tuple[float, bool]]:
    """Confidence of every keypoint judged present, in every draw, and whether the shape has it and has it within
    `NEAR`; nothing where the shape is not annotated, or the method tells no confidence."""
    shape, truth, geodesic = found.normalized, found.keypoints, found.distances
    if shape is None or truth is None or geodesic is None or not len(truth.ids):
        return []
    at = dict(zip(truth.ids.tolist(), keypoint_candidates(truth, shape).tolist(), strict=True))
    pairs = []
    for attempt in found.attempts:
        prediction = attempt.prediction
        if prediction.confidence is None:
            continue
        for number, point, here, sure in zip(
            prediction.ids.tolist(), prediction.points, prediction.present, prediction.confidence, strict=True
        ):
            if here:
                pairs.append((float(sure), number in at and bool(geodesic.distances[point, at[number]] <= NEAR)))
    return pairs
