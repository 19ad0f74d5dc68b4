"""stability: how alike the same points' features stay when one parameter of the extraction is swept (the paper's figure
4)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from b23d.schemas.wording import counted
from b23d.stages.workbench.analyses.comparing import centred, cosine
from b23d.stages.workbench.analyses.drawing import SOFT, add_band, finish
from b23d.stages.workbench.analyses.interface import AnalysisParams, Chart, ExecutedMember, Result
from b23d.stages.workbench.pictures.palette import class_color


class Parameters(AnalysisParams):
    kind: Literal["stability"]
    reference: float
    """The swept value whose features all others are compared with."""
    features: Literal["backproject", "reweight"] = "backproject"
    """As seen by the views, or smoothed along the surface, too."""


@dataclass(frozen=True)
class Axis:
    """How a swept field is drawn, and a mark that the paper sets."""

    title: str
    column: str
    """The table's word for it."""
    unit: str = ""
    """Written behind its numbers."""
    of: Callable[[Any], float] = float
    ticks: float | None = None
    across: tuple[float, str] | None = None
    """A similarity, and what it is."""
    upright: tuple[float, str] | None = None
    """A place on the axis, and what it is."""


def views_of(rings: int) -> int:
    """2n(n + 1) + 2 views of n rings."""
    return 2 * rings * (rings + 1) + 2


AXES = {
    "stages.render.rings.count": Axis(
        "number of views", "views", " views", views_of, upright=(50, "paper: converges near 50")
    ),
    "stages.render.distance_factor": Axis(
        "camera's distance, × the least at which the whole shape is seen", "distance", " × the least distance"
    ),
    "stages.render.azimuth_offset": Axis(
        "rotation about the up axis, degrees", "degrees", "°", ticks=15, across=(0.99, "paper: always above .99")
    ),
}


def needs(params: Parameters) -> list[str]:
    return [params.features]


def analyse(parts: list[ExecutedMember], params: Parameters) -> Result:
    """Raises ValueError where no run has the reference value, or where a run's points are not the reference's."""
    reference = next((part for part in parts if part.value == params.reference), None)
    if reference is None:
        values = ", ".join(str(part.value) for part in parts)
        raise ValueError(
            f"analysis.reference: expected one of the swept values {values}, got {params.reference!r}; sweep it, too"
        )
    if not all(isinstance(part.value, int | float) for part in parts):
        raise ValueError(
            f"stability: expected a sweep over a number of a stage, got {reference.series}; "
            "compare others with [variants]"
        )
    axis = AXES.get(reference.series, Axis(reference.series, reference.series.split(".")[-1]))
    rows = [{"x": axis.of(part.value), **_compared(part, reference)} for part in parts]
    table = pd.DataFrame(rows).sort_values("x", ignore_index=True).rename(columns={"x": axis.column})
    return Result(
        f"Feature stability: {axis.title.split(',')[0]}", table,
        "cosine: mean cosine similarity of a point's feature with its feature at the reference, "
        "over all points that views see in both, of "
        "all shapes; sd: standard deviation over these; 5 %: a twentieth of them is below; "
        "centred: the same after the shape's mean "
        "feature is taken away, which its points share; least shape: the lowest mean of one; seen: share compared.",
        [Chart(_figure(table, axis, axis.of(params.reference)), _caption(reference, params))],
    )  # fmt: skip


def _compared(part: ExecutedMember, reference: ExecutedMember) -> dict[str, float]:
    plain, without, seen = [], [], []
    others = {entry.shape.name: features for entry, _, features in part.described()}
    for entry, _, expected in reference.described():
        found = others.get(entry.shape.name)
        if found is None:
            continue
        if found.features.shape != expected.features.shape:
            raise ValueError(
                f"{entry.shape.name}: expected features {expected.features.shape} as in the reference, "
                f"got {found.features.shape} "
                f"for {part.label}; sweep what leaves candidates and encoder as they are"
            )
        both = found.observed & expected.observed
        seen.append(float(both.mean()))
        if both.any():
            a, b = found.features[both], expected.features[both]
            plain.append(cosine(a, b))
            without.append(cosine(centred(a, b), centred(b, b)))
    if not plain:
        raise ValueError(
            f"{part.label}: expected points that its views and the reference's both see, got none; check the run"
        )
    every, rest = np.concatenate(plain), np.concatenate(without)
    return {
        "cosine": every.mean(), "sd": every.std(), "5 %": float(np.percentile(every, 5)), "centred": rest.mean(),
        "centred sd": rest.std(),
        "least shape": min(float(each.mean()) for each in plain), "seen": float(np.mean(seen)), "shapes": len(plain),
    }  # fmt: skip


def _figure(table: pd.DataFrame, axis: Axis, reference: float) -> go.Figure:
    figure, x = go.Figure(), table[axis.column].to_numpy(float)
    for name, sd, title, color, dash in (
        ("cosine", "sd", "cosine similarity", class_color(0), "solid"),
        ("centred", "centred sd", "of centred features", class_color(1), "dot"),
    ):  # fmt: skip
        add_band(figure, x, table[name].to_numpy(), table[sd].to_numpy(), name, color)
        figure.add_scatter(
            x=x.tolist(), y=table[name].tolist(), name=f"{title}, mean ± sd", mode="lines+markers", legendgroup=name,
            marker={"size": 7},
            line={"color": color, "width": 2.5, "dash": dash}, customdata=table[sd].tolist(),
            hovertemplate="%{x:.4g}: %{y:.4f} ± %{customdata:.4f}<extra>" + title + "</extra>",
        )  # fmt: skip
    low = max(float((table["centred"] - table["centred sd"]).min()) - 0.03, -1)
    grey = {"color": SOFT, "dash": "dash", "width": 1.5}
    if axis.across is not None:
        at, says = axis.across
        figure.add_scatter(x=[x.min(), x.max()], y=[at, at], mode="lines", line=grey, name=says, hoverinfo="skip")
    if axis.upright is not None:
        at, says = axis.upright
        figure.add_scatter(x=[at, at], y=[low, 1], mode="lines", line=grey, name=says, hoverinfo="skip")
    diamond = {"symbol": "diamond", "size": 11, "color": "#1b2230"}
    figure.add_scatter(x=[reference], y=[1], mode="markers", marker=diamond, name="reference", hoverinfo="skip")
    figure.update_yaxes(range=[low, 1.02])
    figure.update_xaxes(dtick=axis.ticks)
    return finish(figure, axis.title, f"similarity to the features at {reference:g}{axis.unit}")


def _caption(reference: ExecutedMember, params: Parameters) -> str:
    entries = list(reference.described())
    shapes, points = len(entries), sum(len(features.observed) for _, _, features in entries)
    smoothed = "smoothed" if params.features == "reweight" else "as the views give them"
    what = f"{counted(shapes, 'shape')}, {points:,} points; features of {entries[0][2].descriptor}, {smoothed}"
    return f"{what}. Bands: ± one standard deviation."
