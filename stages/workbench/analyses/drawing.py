"""What the charts of all analyses have in common: lines with bands, and one look."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from b23d.stages.workbench.pictures.palette import rgb

SOFT = "#5b6577"


def add_band(
    figure: go.Figure, x: np.ndarray, mean: np.ndarray, sd: np.ndarray, name: str, color: str, **where: int
) -> None:
    """mean ± sd as a band without a legend entry; a line called `name` shows and hides it."""
    red, green, blue = rgb(color)
    figure.add_scatter(
        x=np.concatenate([x, x[::-1]]).tolist(), y=np.concatenate([mean + sd, (mean - sd)[::-1]]).tolist(),
        fill="toself", mode="lines",
        line={"width": 0}, fillcolor=f"rgba({red},{green},{blue},.14)", hoverinfo="skip", showlegend=False,
        legendgroup=name, **where,
    )  # fmt: skip


def finish(figure: go.Figure, x: str, y: str, height: int = 460) -> go.Figure:
    """Axis titles, the legend below, and room around; the figure itself."""
    figure.update_layout(template="plotly_white", height=height, margin={"l": 70, "r": 20, "t": 40, "b": 60})
    figure.update_layout(legend={"orientation": "h", "x": 0, "y": -0.18, "yanchor": "top"}, font={"size": 13})
    figure.update_xaxes(title={"text": x})
    figure.update_layout(yaxis={"title": {"text": y}})
    return figure
