"""score: compare predicted keypoints with annotated ones, by KeypointNet's protocol and stricter ones."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from b23d.pipeline.stage import Hints, stage
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.params import Params
from b23d.schemas.predictions import Prediction
from b23d.schemas.scores import ShapeScore
from b23d.schemas.shape import NormalizedShape

Threshold = Annotated[float, Field(ge=0)]


class ScoreParams(Params):
    """When a prediction counts as right. Defaults: the protocol that the paper's figures follow."""

    thresholds: tuple[Threshold, ...] = Field(default=tuple(i / 100 for i in range(11)), min_length=1)
    """Distances at which to count, in `units`."""
    inside: Literal["<=", "<"] = "<="
    """Whether a distance equal to the threshold is within it. The paper's text says "smaller than", but then nothing is
    right at 0."""
    iou: Literal["many-to-one", "one-to-one"] = "many-to-one"
    """What true and false positives and false negatives count, names aside. "many-to-one": keypoints near any
    prediction, and predictions near no keypoint, so that one prediction may account for several keypoints (KeypointNet,
    UKPGAN, the published code). "one-to-one": pairs of the largest matching. Sums over a class give its IoU; the mean
    over classes is of these."""
    units: Literal["dataset", "unit"] = "dataset"
    """"dataset": distances of the shape as it is in the data set. "unit": of the shape with its longest side 1."""
    neighbors: int = Field(default=20, ge=1)
    """Nearest others that each point is linked to in the graph that distances run along."""


@stage(version=2, hints=Hints(memory_gb=0.3))
def score(
    normalize: NormalizedShape,
    optimize: Prediction,
    keypoints: Keypoints,
    shot_keypoints: list[Keypoints],
    params: ScoreParams,
) -> ShapeScore:
    """Counts at every threshold, for all kinds of score; ratios are taken over a class, by `stages/scoring/summary.py`.

    Only predictions judged present count. Raises ValueError where a predicted or annotated point lies beyond the
    candidates.
    """
    from b23d.stages.scoring.distances import keypoint_distances
    from b23d.stages.scoring.iou import count, count_pairs, within
    from b23d.stages.scoring.matching import labelled, matched, symmetric
    from b23d.stages.scoring.symmetry import exchanges, fronts

    present, upright = optimize.present, normalize.to_unit(keypoints.positions)
    ids, points, annotated = optimize.ids[present], optimize.points[present], keypoints.ids
    thresholds = np.asarray(params.thresholds, np.float64)
    distances = keypoint_distances(normalize, points, keypoints, params.neighbors, params.units)
    hits = within(distances, thresholds, params.inside)
    pairs = matched(hits)
    counts = count(hits) if params.iou == "many-to-one" else count_pairs(pairs, len(points), len(annotated))
    seen = np.unique(np.concatenate([np.zeros(0, np.int32), *(shot.ids for shot in shot_keypoints)]))
    return ShapeScore(
        thresholds=thresholds,
        true_positives=counts.true_positives,
        false_positives=counts.false_positives,
        false_negatives=counts.false_negatives,
        matched=pairs,
        labelled=labelled(hits, ids, annotated),
        symmetric=symmetric(hits, ids, exchanges(keypoints, upright)),
        either_front=symmetric(hits, ids, fronts(annotated, upright)),
        annotated=len(annotated),
        predicted=len(points),
        common=len(np.intersect1d(ids[ids >= 0], annotated)),
        ceiling=np.array([len(np.intersect1d(seen, annotated)), len(np.union1d(seen, annotated))], np.int32),
        distances=distances.astype(np.float32),
        protocol=protocol(params, normalize.candidates),
        annotation_file=keypoints.annotation_file,
    )


def protocol(params: ScoreParams, candidates: str) -> str:
    """How these counts were made, in one line."""
    units = "data set's units" if params.units == "dataset" else "longest side 1"
    pairs = "" if params.iou == "many-to-one" else "one-to-one, "
    return f"{pairs}{params.inside} threshold along the {params.neighbors}-NN graph, {units}, candidates {candidates}"
