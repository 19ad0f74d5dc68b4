"""Colours of candidates that mean the same on every shape of a class."""

from __future__ import annotations

import numpy as np

from b23d.pipeline.errors import B23dError
from b23d.schemas.features import PointFeatures
from b23d.stages.workbench.pictures.principal import Basis, fit_basis
from b23d.stages.workbench.results.gathering import Gathering

FITTED = 64  # shapes of a class that its basis is fitted on
PLASMA = np.array(
    [
        [13, 8, 135],
        [76, 2, 161],
        [126, 3, 168],
        [169, 35, 149],
        [204, 71, 120],
        [229, 108, 92],
        [248, 149, 64],
        [253, 196, 39],
        [240, 249, 33],
    ]
)
"""Nine stops of matplotlib's map of that name (CC0)."""


def class_basis(gathered: Gathering, category: str, stage: str | None = None) -> Basis | None:
    """The basis of a class's features, of at most 64 of its shapes, evenly taken; None where none has any.

    stage: whose features; None: smoothed ones, else unsmoothed. Points that no view saw are left out where others are.
    """
    shapes = [shape for shape in gathered.run.shapes if shape.category == category]
    found = []
    for shape in shapes[:: max(1, len(shapes) // FITTED)]:
        try:
            features = gathered.features(shape, stage)
            if features is not None:
                found.append(features.features[features.observed] if features.observed.any() else features.features)
        except B23dError:  # a damaged artifact: the others tell enough
            continue
    return fit_basis(found) if found else None


def feature_colors(features: PointFeatures | None, basis: Basis | None) -> np.ndarray | None:
    """(n, 3) uint8, or None where there is nothing to colour by."""
    if features is None or basis is None:
        return None
    return basis.colors(basis.project(features.features))


def plasma(values: np.ndarray) -> np.ndarray:
    """(n,) in 0 … 1 → (n, 3) uint8."""
    stops = np.linspace(0, 1, len(PLASMA))
    return (
        np.stack([np.interp(values, stops, PLASMA[:, channel]) for channel in range(3)], axis=1)
        .round()
        .astype(np.uint8)
    )
