"""correspondence: dense matches between two shapes whose points correspond, against the truth."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal, get_args

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from b23d.stages.correspondence.matching import Method, correspond
from b23d.stages.correspondence.surfaces import FeaturedSurface
from b23d.stages.workbench.analyses.drawing import finish
from b23d.stages.workbench.analyses.interface import AnalysisParams, Chart, ExecutedMember, Result, classes_of
from b23d.stages.workbench.pictures.palette import class_color
from b23d.stages.workbench.results.gathering import ShapeResults

ERRORS = np.linspace(0, 0.5, 51)
MatchErrors = dict[tuple[str, str, str], tuple[np.ndarray, np.ndarray]]


class Parameters(AnalysisParams):
    kind: Literal["correspondence"]
    within: float = 0.05
    """The table's share of points counts errors up to this, in longest sides."""


def needs(params: Parameters) -> list[str]:
    return ["normalize", "reweight", "geodesic"]


def analyse(parts: list[ExecutedMember], params: Parameters) -> Result:
    """Raises ValueError where no class has two shapes whose candidates correspond."""
    found: MatchErrors = {}
    failed: list[str] = []
    for part in parts:
        for category in classes_of(part):
            try:
                found |= {(part.label, category, method): errors for method, errors in _errors(part, category)}
            except ValueError as error:  # the other pairs are as good as they were
                failed.append(f"{part.label}: {error}")
    if not found:
        raise ValueError("\n".join(failed) or "expected pairs of shapes, got none; see what failed with b23d run")
    rows = [
        {
            "descriptor": label, "pair": pair, "matches": method, "error": plain.mean(), "error sd": plain.std(),
            f"≤ {params.within:g}": float((plain <= params.within).mean()), "sides exchanged": either.mean(),
            f"≤ {params.within:g}, sides exchanged": float((either <= params.within).mean()), "points": len(plain),
        }
        for (label, pair, method), (plain, either) in found.items()
    ]  # fmt: skip
    return Result(
        "Dense correspondence", pd.DataFrame(rows),
        "error: mean distance along the surface between where a point is matched to and where it is, longest sides, "
        "over points that views see; nearest: the most alike descriptor; consistent: with mutual distances and sides, "
        "too; smooth: such a map, refined in the surface's own waves; sides exchanged: the point's mirror "
        "image counts as right, too (x = 0 of the first shape)." + "".join(f" Left out: {one}." for one in failed),
        [Chart(_figure(found), "Mean over pairs of the share of points within each error; dotted: sides exchanged.")],
    )  # fmt: skip


def _errors(part: ExecutedMember, category: str) -> Iterator[tuple[str, tuple[np.ndarray, np.ndarray]]]:
    """Method → error of each seen point, and the less of it and that from the mirror image."""
    entries = [entry for entry in part.entries.values() if entry.shape.category == category]
    if len(entries) < 2:
        raise ValueError(f"{category}: expected two shapes to match, got {len(entries)}; see what failed with b23d run")
    first, second = entries[:2]
    (here, seen), (there, _) = (_read(entry) for entry in (first, second))
    if len(here.points) != len(there.points):
        raise ValueError(
            f"{second.shape.name}: expected candidates that correspond to those of {first.shape.name}, got "
            f'{len(there.points)} for {len(here.points)}; take a data set whose shapes do, as "pairs"'
        )
    from scipy.spatial import cKDTree

    image = cKDTree(here.points).query(here.points * np.array([-1.0, 1.0, 1.0]))[1]
    apart = there.reach()
    for method in get_args(Method):
        matched = correspond(here, there, method)
        plain = apart[np.arange(len(here.points)), matched].astype(np.float64)
        either = np.minimum(plain, apart[image, matched])
        yield method, (plain[seen], either[seen])


def _read(entry: ShapeResults) -> tuple[FeaturedSurface, np.ndarray]:
    """A shape, and (n,) which of its points some view saw."""
    if entry.normalized is None or entry.features is None or entry.distances is None:
        raise ValueError(
            f"{entry.shape.name}: expected features and distances, got none; see what failed with b23d run"
        )
    points, distances = entry.normalized.points.astype(np.float64), entry.distances.distances
    return FeaturedSurface(points, entry.features.features, distances, entry.shape.name), entry.features.observed


def _figure(found: MatchErrors) -> go.Figure:
    figure = go.Figure()
    for place, (label, method) in enumerate(dict.fromkeys((label, method) for label, _, method in found)):
        errors = [value for (one, _, other), value in found.items() if (one, other) == (label, method)]
        for which, dash in enumerate(("solid", "dot")):
            curve = np.mean([(error[which][:, None] <= ERRORS).mean(axis=0) for error in errors], axis=0)
            figure.add_scatter(
                x=ERRORS.tolist(), y=curve.tolist(), name=f"{label}, {method}", legendgroup=f"{label}, {method}",
                showlegend=which == 0, mode="lines", line={"color": class_color(place), "width": 2.5, "dash": dash},
                hovertemplate="%{y:.0%} within %{x:.2f}<extra>" + f"{label}, {method}</extra>",
            )  # fmt: skip
    figure.update_yaxes(range=[0, 1.01], tickformat=".0%")
    return finish(figure, "geodesic error, longest sides", "points")
