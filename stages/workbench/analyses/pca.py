"""pca: features as colours, by one principal component analysis of a whole class (the paper's figures 5 and 12)."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pandas as pd

from b23d.schemas.wording import counted
from b23d.stages.workbench.analyses.interface import AnalysisParams, ExecutedMember, Pictures, Result, classes_of
from b23d.stages.workbench.pictures.painting import picture
from b23d.stages.workbench.pictures.principal import fit_basis

PIXELS = 420  # shown at half that, or less


class Parameters(AnalysisParams):
    kind: Literal["pca"]
    points: int = 2048
    """Of each shape, to fit on (the paper's number)."""
    features: Literal["backproject", "reweight"] = "reweight"
    """As seen by the views, or smoothed along the surface, too, so that points that no view saw have a colour."""


def needs(params: Parameters) -> list[str]:
    return ["normalize", params.features]


def analyse(parts: list[ExecutedMember], params: Parameters) -> Result:
    """Raises ValueError where a class has no features."""
    rows, blocks = [], []
    for category in classes_of(parts[0]):
        lines = []
        for part in parts:
            shapes = [item for item in part.described() if item[0].shape.category == category]
            if not shapes:
                continue
            seen = [features.features[features.observed] for _, _, features in shapes]
            basis = fit_basis(seen, params.points)
            pooled = np.concatenate(seen).astype(np.float64) - basis.mean
            shares = ((pooled @ basis.components[:3].T) ** 2).sum(axis=0) / max(float((pooled**2).sum()), 1e-12)
            rows.append({
                "class": category, "descriptor": part.label, "shapes": len(shapes), "channels": pooled.shape[1],
                "first": shares[0], "three": shares.sum(),
            })  # fmt: skip
            drawn = [
                (e.shape.id, picture(shape, basis.colors(basis.project(f.features)), PIXELS)) for e, shape, f in shapes
            ]
            lines.append((part.label, drawn))
        caption = (
            f"The first three components of one PCA of the features of {counted(len(lines[0][1]), 'shape')}, as red, "
            "green and blue."
        )
        blocks.append(Pictures(category, caption, lines))
    return Result(
        "Joint principal components", pd.DataFrame(rows),
        "first, three: share of the variance that the first component, and the three that colours show, hold.",
        list(blocks),
    )  # fmt: skip
