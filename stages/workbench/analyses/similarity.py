"""similarity: how descriptors differ between corresponding points of two shapes, near what differs and far from it.

The paper's two isometric cubes (figure 6) and its local changes (supplement): a data set of pairs, several descriptors.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from b23d.schemas.features import PointFeatures
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.wording import counted
from b23d.stages.workbench.analyses.comparing import cosine, typical_difference
from b23d.stages.workbench.analyses.drawing import add_band, finish
from b23d.stages.workbench.analyses.interface import (
    AnalysisParams,
    Chart,
    ExecutedMember,
    Pictures,
    Result,
    Scale,
    classes_of,
)
from b23d.stages.workbench.pictures.coloring import plasma
from b23d.stages.workbench.pictures.painting import picture
from b23d.stages.workbench.pictures.palette import class_color

PIXELS = 480  # shown at half that, or less
MOVED = 1e-3  # share of the shape's longest side: points that lie farther apart than this were changed
BINS = 12
DASHES = ("solid", "solid", "dash", "dot")  # lines that lie upon each other are all seen


class Parameters(AnalysisParams):
    kind: Literal["similarity"]
    reference: str | None = None
    """Id of the shape that the others of its class are compared with; None: the first by name."""
    zones: list[float] = [0.1, 0.3]
    """Distances from what was changed, unit frame, that the table's zones end at."""
    features: Literal["backproject", "reweight"] = "backproject"


@dataclass(frozen=True)
class ComparedPair:
    """One shape against the reference of its class, point by point."""

    name: str
    shapes: tuple[NormalizedShape, NormalizedShape]
    labels: tuple[str, str]
    away: np.ndarray
    """(n,) distance from the nearest changed point of either shape, unit frame of the reference; 0 where changed."""
    seen: np.ndarray
    """(n,) bool: described on both."""
    cosine: np.ndarray
    difference: np.ndarray
    """(n,) Euclidean, over the median one between two random points of the reference."""


def needs(params: Parameters) -> list[str]:
    return ["normalize", params.features]


def analyse(parts: list[ExecutedMember], params: Parameters) -> Result:
    """Raises ValueError where a class has no two shapes, or their candidates do not correspond."""
    found = [(part.label, _pairs(part, params)) for part in parts]
    rows = [row for label, pairs in found for pair in pairs for row in _rows(label, pair, params.zones)]
    scale = Scale(
        "difference of descriptors between corresponding points",
        "none",
        "as between two random points of the shape, or more",
    )
    lines = [(label, [image for pair in pairs for image in _drawn(pair)]) for label, pairs in found]
    caption = (
        "Each shape is coloured by how much its points' descriptors differ "
        "from those of the corresponding points of the other."
    )
    return Result(
        "Descriptors of corresponding points", pd.DataFrame(rows),
        "difference: mean Euclidean distance between a point's descriptors on the two shapes, over the median "
        "distance between those of two random points of the reference: 0 if the descriptor does not tell the shapes "
        "apart there, 1 if it changes as much as from one place to any other; cosine: mean cosine similarity; zones: "
        "by the distance from what was changed, in longest sides.",
        [
            Pictures("Where descriptors change", caption, lines, scale),
            Chart(_figure(found), "Mean ± one standard deviation over points."),
        ],
    )  # fmt: skip


def _pairs(part: ExecutedMember, params: Parameters) -> list[ComparedPair]:
    pairs = []
    for category in classes_of(part):
        shapes = [item for item in part.described() if item[0].shape.category == category]
        ids = [entry.shape.id for entry, _, _ in shapes]
        if len(shapes) < 2 or params.reference not in (None, *ids):
            wanted = f"the reference {params.reference!r} and another" if params.reference else "two shapes"
            raise ValueError(
                f"{category}: expected {wanted} to compare, got {', '.join(ids) or 'none'}; "
                "see what failed with b23d run"
            )
        at = ids.index(params.reference) if params.reference else 0
        _, first, expected = shapes[at]
        for entry, second, found in shapes[:at] + shapes[at + 1 :]:
            pairs.append(_pair((f"{category}/{ids[at]}", entry.shape.name), (first, second), (expected, found)))
    return pairs


def _pair(
    names: tuple[str, str],
    shapes: tuple[NormalizedShape, NormalizedShape],
    features: tuple[PointFeatures, PointFeatures],
) -> ComparedPair:
    from scipy.spatial import cKDTree

    first, second = shapes
    if len(first.points) != len(second.points) or first.candidates != "cloud" or second.candidates != "cloud":
        raise ValueError(
            f"{names[1]}: expected a cloud whose points correspond to those of {names[0]}, "
            f"got {counted(len(second.points), 'candidate')} "
            f'({second.candidates}); give both a cloud, as the data set "pairs" does'
        )
    there = first.to_unit(
        second.to_source(second.points.astype(np.float64))
    )  # the second's points in the first's frame
    changed = np.linalg.norm(there - first.points, axis=1) > MOVED
    if changed.any():
        away = np.minimum(
            cKDTree(first.points[changed]).query(first.points)[0], cKDTree(there[changed]).query(there)[0]
        )
    else:
        away = np.full(len(there), np.inf)
    a, b = (each.features.astype(np.float64) for each in features)
    seen = features[0].observed & features[1].observed
    typical = typical_difference(a[features[0].observed]) or 1.0
    return ComparedPair(
        names[0].split("/")[0], shapes, (names[0], names[1]), np.where(changed, 0.0, away), seen, cosine(a, b),
        np.linalg.norm(a - b, axis=1) / typical,
    )  # fmt: skip


def _rows(label: str, pair: ComparedPair, zones: list[float]) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    named = [("changed", pair.away == 0), (f"< {zones[0]:g}", (pair.away > 0) & (pair.away < zones[0]))]
    named += [(f"{low:g} – {high:g}", (pair.away >= low) & (pair.away < high)) for low, high in pairwise(zones)]
    named.append((f"> {zones[-1]:g}", pair.away >= zones[-1]))
    for zone, chosen in named:
        chosen = chosen & pair.seen
        if chosen.any():
            difference, alike = pair.difference[chosen], pair.cosine[chosen]
            rows.append({
                "pair": pair.name, "descriptor": label, "zone": zone, "difference": difference.mean(),
                "difference sd": difference.std(),
                "cosine": alike.mean(), "cosine sd": alike.std(), "points": int(chosen.sum()),
            })  # fmt: skip
    return rows


def _drawn(pair: ComparedPair) -> list[tuple[str, np.ndarray]]:
    colors = plasma(np.clip(pair.difference, 0, 1))
    colors[~pair.seen] = 160
    return [(label, picture(shape, colors, PIXELS)) for label, shape in zip(pair.labels, pair.shapes, strict=True)]


def _figure(found: list[tuple[str, list[ComparedPair]]]) -> go.Figure:
    """Difference over distance from what was changed: a column a pair, a line a descriptor."""
    from plotly.subplots import make_subplots

    names = [pair.labels[1] for pair in found[0][1]]
    figure = make_subplots(1, len(names), shared_yaxes=True, subplot_titles=names, horizontal_spacing=0.03)
    for place, (label, pairs) in enumerate(found):
        color = class_color(place)
        for column, pair in enumerate(pairs, 1):
            x, mean, sd = _binned(pair)
            add_band(figure, x, mean, sd, label, color, row=1, col=column)
            figure.add_scatter(
                x=x.tolist(), y=mean.tolist(), name=label, legendgroup=label, showlegend=column == 1,
                mode="lines+markers",
                line={"color": color, "width": 2.5, "dash": DASHES[place % len(DASHES)]}, marker={"size": 6}, row=1,
                col=column,
                hovertemplate="%{x:.2f}: %{y:.3f}<extra>" + label + "</extra>",
            )  # fmt: skip
    figure.update_xaxes(rangemode="tozero")
    figure.update_yaxes(range=[0, 1.5])
    return finish(figure, "distance from the change, longest sides", "difference / typical difference")


def _binned(pair: ComparedPair) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middles, means and standard deviations of the difference: changed points first, at 0, then equally wide bins."""
    finite = np.where(np.isfinite(pair.away), pair.away, 0)
    edges = np.linspace(0, float(finite.max()) or 1.0, BINS + 1)
    which = np.where(finite > 0, np.digitize(finite, edges[1:-1]) + 1, 0)
    filled = [bin for bin in range(BINS + 1) if (pair.seen & (which == bin)).any()]
    values = [pair.difference[pair.seen & (which == bin)] for bin in filled]
    middles = np.concatenate([[0.0], (edges[1:] + edges[:-1]) / 2])
    return middles[filled], np.array([v.mean() for v in values]), np.array([v.std() for v in values])
