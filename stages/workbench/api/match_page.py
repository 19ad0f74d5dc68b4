"""A match side by side, as one HTML file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from b23d.stages.workbench.api.matching import Match
from b23d.stages.workbench.pictures.figures import CAMERA
from b23d.stages.workbench.pictures.surface import surface_of


def write_match_page(found: Match, names: tuple[str, str], path: Path) -> None:
    """b with its colours on the left, a with what it took over on the right, turned together."""
    from plotly.subplots import make_subplots

    titles = [f"{names[1]}: its own colours", f"{names[0]}: colours of what looks alike on {names[1]}"]
    figure = make_subplots(1, 2, specs=[[{"type": "scene"}] * 2], subplot_titles=titles, horizontal_spacing=0.01)
    for column, (shape, places, colors) in enumerate(
        [(found.b, found.b.points, found.candidate_colors), (found.a, found.a.vertices, found.colors)], start=1
    ):
        figure.add_trace(_drawn(shape, places, colors), row=1, col=column)
    hidden = {"visible": False}
    scene = {"aspectmode": "data", "camera": CAMERA, "xaxis": hidden, "yaxis": hidden, "zaxis": hidden}
    figure.update_layout(scene=scene, scene2=scene, margin={"l": 0, "r": 0, "t": 40, "b": 0}, template="none")
    path.parent.mkdir(parents=True, exist_ok=True)
    page = figure.to_html(include_plotlyjs=True, full_html=True, post_script=TOGETHER, config={"responsive": True})
    path.write_text(page, encoding="utf-8")


TOGETHER = """
const plot = document.getElementById('{plot_id}'), scenes = ['scene', 'scene2'];
plot.on('plotly_relayouting', follow); plot.on('plotly_relayout', follow);
let busy = false;
function follow(change) {
  for (const [from, to] of [scenes, [...scenes].reverse()]) {
    const camera = change[`${from}.camera`];
    if (!camera || busy) continue;
    busy = true;
    Plotly.relayout(plot, {[`${to}.camera`]: camera}).then(() => { busy = false; });
  }
}
"""


def _drawn(shape: Any, places: np.ndarray, colors: np.ndarray) -> Any:
    """A trace of the shape, coloured by the nearest of `places` (n, 3)."""
    import plotly.graph_objects as go
    from scipy.spatial import cKDTree

    words = np.array([f"rgb({red},{green},{blue})" for red, green, blue in colors])
    surface = surface_of(shape)
    if surface is None:
        x, y, z = places.astype(np.float64).T
        return go.Scatter3d(x=x, y=y, z=z, mode="markers", marker={"size": 3, "color": words}, showlegend=False)
    x, y, z = surface.vertices.astype(np.float64).T
    i, j, k = surface.faces.T
    near = cKDTree(places).query(surface.vertices)[1]
    lighting = {"ambient": 0.7, "facenormalsepsilon": 1e-16, "vertexnormalsepsilon": 1e-16}
    return go.Mesh3d(
        x=x, y=y, z=z, i=i, j=j, k=k, vertexcolor=words[near], flatshading=True, hoverinfo="skip", lighting=lighting
    )
