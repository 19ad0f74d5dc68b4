"""What shots ask for, of shots of which a few numbers alone are given."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from b23d.schemas.shot_model import ShotModel
from b23d.stages.learn import learn
from b23d.stages.solvers.learn_options import LearnParams
from b23d.stages.solvers.template import Template, template_of
from tests.made_spheres import AT, IDS, labelled

Few = tuple[list[int], list[float], np.ndarray]
"""Ids of a shot, the one channel of each keypoint's feature, and their mutual distances, as the shot has them."""


def combined(*shots: Few, weights: list[float] | None = None, **template: Any) -> Template:
    """The template of shots of which this alone is known."""
    ids = sorted({i for own, _, _ in shots for i in own})
    model = learn_stand_in(ids, shots, {"combine": "mean", "mask": "pairs", **template})
    return template_of(model, np.array(weights or [1.0] * len(shots)))


def learn_stand_in(ids: list[int], shots: Sequence[Few], template: dict[str, Any]) -> ShotModel:
    made = learn(*(list(column) for column in zip(*[labelled(0, IDS, AT)], strict=True)), LearnParams())  # type: ignore[arg-type]
    s, k = len(shots), len(ids)
    has, features, distances = np.zeros((s, k), bool), np.zeros((s, k, 1), np.float32), np.zeros((s, k, k), np.float32)
    for i, (own, values, between) in enumerate(shots):
        rows = np.searchsorted(ids, own)
        has[i, rows], features[i, rows, 0], distances[i][np.ix_(rows, rows)] = True, values, between
    return made.model_copy(
        update={
            "shots": [str(i) for i in range(s)],
            "ids": np.array(ids, np.int32),
            "has": has,
            "features": features,
            "distances": distances,
            **template,
        }
    )


def line(*places: float) -> np.ndarray:
    return np.abs(np.subtract.outer(places, places))
