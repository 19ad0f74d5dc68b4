"""Figures of a run for notebooks and for the report: score curves, and a shape with its keypoints.

>>> from b23d import load
>>> plot_shape(load("runs/demo.toml"), "chair/chair-0003")
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

from b23d.pipeline.planning.hinting import hint
from b23d.schemas.scores import ClassScores, ScoreTable
from b23d.schemas.shape import NormalizedShape
from b23d.stages.scoring.quoted import CURVES, THRESHOLDS, QuotedCurve
from b23d.stages.workbench.pictures.palette import class_color, id_color, rgb

if TYPE_CHECKING:
    import plotly.graph_objects as go

    from b23d.pipeline.run import Run

MEAN = "#d0365a"
QUOTED_COLOR = "#8b93a1"
BAND = 0.14  # opacity of ± sd
CAMERA = {"up": {"x": 0, "y": 1, "z": 0}, "eye": {"x": 1.05, "y": 0.75, "z": -1.35}}


def score_curves(table: ScoreTable, quoted: bool = True) -> go.Figure:
    """IoU over threshold: a curve with its sd band a class, their mean, and the paper's curves if `quoted`."""
    import plotly.graph_objects as go

    figure = go.Figure()
    curves = [(name, scores, class_color(i)) for i, (name, scores) in enumerate(table.classes.items())]
    if len(curves) > 1:
        curves.append(("mean", table.mean, MEAN))
    for name, scores, color in curves:
        add_curve(figure, name, scores, color, wide=name == "mean" or len(curves) == 1)
    add_quoted(figure, CURVES if quoted else ())
    return figure.update_layout(curve_layout(max(table.mean.thresholds)))


def curve_layout(largest: float) -> dict[str, Any]:
    """Axes and legend of IoU over threshold, up to the largest threshold."""
    return {
        "template": "none",
        "height": 430,
        "margin": {"l": 48, "r": 8, "t": 8, "b": 44},
        "hovermode": "closest",
        "hoverlabel": {"align": "left"},
        "xaxis": {"title": {"text": "threshold"}, "range": [0, largest * 1.02], "zeroline": False, "tickformat": ".2f"},
        "yaxis": {"title": {"text": "IoU"}, "range": [0, 1], "zeroline": False},
        "legend": {"orientation": "h", "x": 0, "y": -0.17},
    }


def add_quoted(figure: go.Figure, curves: Iterable[QuotedCurve]) -> None:
    """The paper's printed curves, dashed and grey, and marked as the paper's."""
    for curve, dash in zip(curves, ("dash", "dot"), strict=False):
        words = "<br>".join([curve.system, *curve.source.split("; "), "%{x}: %{y:.2f}"])
        figure.add_scatter(
            x=THRESHOLDS,
            y=curve.iou,
            name=f"{curve.system} (paper)",
            mode="lines",
            hovertemplate=f"{words}<extra></extra>",
            line={"color": QUOTED_COLOR, "dash": dash, "width": 2},
        )


def plot_shape(run: Run, shape: str, draw: int | None = None) -> go.Figure:
    """A shape in 3D: its surface or candidates, coloured by its own features' PCA, with predicted and annotated
    keypoints.

    draw: whose prediction; None takes the first there is. Raises KeyError where the run has no such shape, ValueError
    where it has not been normalized yet.
    """
    import plotly.graph_objects as go

    from b23d.stages.workbench.pictures.principal import fit_basis
    from b23d.stages.workbench.results.gathering import Gathering

    named = {item.name: item for item in run.shapes}
    if not isinstance(shape, str) or shape not in named:
        near = hint(str(shape), list(named))
        raise KeyError(f"shape: expected one of run {run.name}, got {shape!r}; {near}")
    entry = Gathering(run).entry(named[shape])
    if entry.normalized is None:
        raise ValueError(f"{shape}: expected a normalized shape, got none; run {run.name} first")
    normalized, attempt = entry.normalized, entry.attempt(draw)
    colors = np.tile(np.array([[141, 150, 165]], np.uint8), (len(normalized.points), 1))
    if entry.features is not None:
        basis = fit_basis([entry.features.features])
        colors = basis.colors(basis.project(entry.features.features))
    figure = go.Figure()
    _add_shape(figure, normalized, colors)
    truth = (
        {} if entry.keypoints is None else dict(zip(entry.keypoints.ids.tolist(), entry.true_positions(), strict=True))
    )
    _add_keypoints(
        figure, truth, "annotated", {"symbol": "circle-open", "size": 11, "color": "#111827", "line": {"width": 3}}
    )
    if attempt is not None:
        chosen = attempt.prediction.present
        found = dict(zip(attempt.prediction.ids[chosen].tolist(), attempt.prediction.positions[chosen], strict=True))
        _add_keypoints(
            figure, found, f"predicted, draw {attempt.draw}", {"size": 8, "color": [id_color(i) for i in found]}
        )
        pairs = [(found[i], truth[i]) for i in found if i in truth]
        if pairs:
            gap = np.full(3, np.nan)
            ends = np.stack([at for pair in pairs for at in (*pair, gap)])
            figure.add_scatter3d(**_xyz(ends), mode="lines", line={"color": "#dc2626", "width": 5}, name="error")
    hidden = {"visible": False}
    scene = {
        "aspectmode": "data",
        "camera": CAMERA,
        "dragmode": "orbit",
        "xaxis": hidden,
        "yaxis": hidden,
        "zaxis": hidden,
    }
    figure.update_layout(title={"text": shape}, scene=scene, margin={"l": 0, "r": 0, "t": 40, "b": 0}, template="none")
    return figure


def _add_shape(figure: go.Figure, shape: NormalizedShape, colors: np.ndarray) -> None:
    """The surface, or a cloud's points, coloured by the nearest candidates' colours (n, 3) uint8."""
    from scipy.spatial import cKDTree

    from b23d.stages.workbench.pictures.surface import surface_of

    words = np.array([f"rgb({red},{green},{blue})" for red, green, blue in colors])
    surface = surface_of(shape)
    if surface is None:
        figure.add_scatter3d(**_xyz(shape.points), mode="markers", marker={"size": 3, "color": words}, name="shape")
        return
    _, near = cKDTree(shape.points).query(surface.vertices)
    corners = dict(zip("ijk", surface.faces.T, strict=True))
    figure.add_mesh3d(
        **_xyz(surface.vertices), **corners, vertexcolor=words[near], flatshading=True, hoverinfo="skip", name="shape"
    )


def add_curve(
    figure: go.Figure, name: str, scores: ClassScores, color: str, wide: bool = False, dash: str = "solid"
) -> None:
    """IoU over threshold of one row of a table, with a band of ± sd over draws."""
    at, mean, sd = np.array(scores.thresholds), np.array(scores.iou.mean), np.array(scores.iou.sd)
    if scores.draws > 1:
        red, green, blue = rgb(color)
        around = np.concatenate([mean + sd, (mean - sd)[::-1]])
        figure.add_scatter(
            x=np.concatenate([at, at[::-1]]).tolist(),
            y=around.clip(0, 1).tolist(),
            fill="toself",
            mode="lines",
            line={"width": 0},
            fillcolor=f"rgba({red},{green},{blue},{BAND})",
            hoverinfo="skip",
            legendgroup=name,
            showlegend=False,
            name=name,
        )
    figure.add_scatter(
        x=at.tolist(),
        y=mean.tolist(),
        name=name,
        legendgroup=name,
        mode="lines+markers",
        marker={"size": 6},
        line={"color": color, "width": 3.5 if wide else 2, "dash": dash},
        customdata=sd.tolist(),
        hovertemplate=f"{name}<br>%{{x}}: %{{y:.3f}}{' ± %{customdata:.3f}' * (scores.draws > 1)}<extra></extra>",
    )


def _add_keypoints(figure: go.Figure, keypoints: dict[int, np.ndarray], name: str, marker: dict[str, Any]) -> None:
    if keypoints:
        at, words = np.stack(list(keypoints.values())), [str(number) for number in keypoints]
        figure.add_scatter3d(**_xyz(at), mode="markers+text", text=words, marker=marker, name=name)


def _xyz(points: np.ndarray) -> dict[str, np.ndarray]:
    """Columns, as floats that every version of plotly writes as plain numbers."""
    return dict(zip("xyz", np.asarray(points, np.float64).T, strict=True))
