"""What of a class's shapes is known before they are annotated: from what the run has stored; nothing is made."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from b23d.pipeline.run import Run
from b23d.stages.solvers.likeness import cosine, occupancy, overlap, standardised
from b23d.stages.solvers.retrieval import mean_feature

MOST = 1000
"""Shapes of a class that are compared with each other; further ones are not proposed."""


@dataclass(frozen=True)
class Looks:
    """Shapes that can be compared; alike (n, n), symmetric; none where too little is stored."""

    names: list[str]
    alike: np.ndarray
    told: str
    """What they are compared by, for people."""


NOTHING = Looks([], np.zeros((0, 0)), "")


def looks_of(run: Run, names: Sequence[str]) -> Looks:
    """By features and geometry, of the shapes that have both stored; where fewer than half have, by geometry; where
    fewer than half have that, not at all."""
    names = list(names)[:MOST]
    places = {name: occupancy(_centred(found.points)) for name in names if (found := _stored(run, name, "normalize"))}
    vectors = {name: mean_feature(found) for name in places if (found := _stored(run, name, "reweight"))}
    if 2 * len(vectors) >= len(names) > 1 and len({len(vector) for vector in vectors.values()}) == 1:
        alike = _pairs(places, list(vectors)) + _compared([vectors[name] for name in vectors], cosine)
        return Looks(list(vectors), alike, "proposed by features and geometry")
    if 2 * len(places) >= len(names) > 1:
        alike = _pairs(places, list(places))
        return Looks(list(places), alike, "proposed by geometry alone, as no features are stored")
    return NOTHING


def _pairs(places: dict[str, np.ndarray], names: list[str]) -> np.ndarray:
    return _compared([places[name] for name in names], overlap)


def _compared(vectors: list[np.ndarray], measure: Any) -> np.ndarray:
    stacked = np.stack(vectors)
    return standardised(np.stack([measure(one, stacked) for one in stacked]))


def _centred(points: np.ndarray) -> np.ndarray:
    low, high = points.min(0), points.max(0)
    return np.asarray((points - (low + high) / 2) / (float((high - low).max()) or 1.0))


def _stored(run: Run, shape: str, stage: str) -> Any:
    """None where it has not been made."""
    try:
        return run.artifact(shape, stage)
    except (KeyError, OSError, ValueError):
        return None
