"""semantic: are descriptors alike at the same keypoint of different shapes of a class, and different elsewhere? (paper:
supplement)

Every keypoint of every shape is looked for on every other shape of its class by its descriptor alone: how much of the
surface is nearer to it in descriptor space than the right point?
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations
from typing import Literal

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from b23d.schemas.keypoints import Keypoints
from b23d.stages.geometry.keypoints import keypoint_candidates
from b23d.stages.solvers.scaling import scale_features
from b23d.stages.workbench.analyses.comparing import nearer_share
from b23d.stages.workbench.analyses.drawing import SOFT, finish
from b23d.stages.workbench.analyses.interface import AnalysisParams, Chart, ExecutedMember, Result, classes_of
from b23d.stages.workbench.pictures.palette import class_color

SHARES = np.geomspace(0.0005, 1, 60)


class Parameters(AnalysisParams):
    kind: Literal["semantic"]
    features: Literal["backproject", "reweight"] = "backproject"
    scale: Literal["raw", "centred", "centred-unit", "standardised"] = "centred-unit"
    """How descriptors are scaled before their Euclidean distances are taken, each shape by itself; as in `learn`."""
    near: float = 0.05
    """Unit frame: points this near to the right one, or to one that the shape's symmetry exchanges with it, are neither
    right nor wrong."""


@dataclass(frozen=True)
class Described:
    """One shape's keypoints and descriptors."""

    keypoints: Keypoints
    points: np.ndarray
    """(n, 3) candidates, unit frame."""
    features: np.ndarray
    """(n, channel) scaled."""
    at: np.ndarray
    """(k,) candidate of each keypoint."""

    def mates(self, row: int) -> np.ndarray:
        """(m,) rows of the keypoints that a symmetry of the shape exchanges with this one, itself included."""
        ids, own = self.keypoints.ids.tolist(), int(self.keypoints.ids[row])
        same = {own}.union(
            *(orbit for orbit in [*self.keypoints.reflections, *self.keypoints.rotations] if own in orbit)
        )
        return np.array([ids.index(i) for i in sorted(same) if i in ids])


def needs(params: Parameters) -> list[str]:
    return ["normalize", params.features]


def analyse(parts: list[ExecutedMember], params: Parameters) -> Result:
    """Raises ValueError where no two shapes of a class have a keypoint in common."""
    rows, curves = [], []
    for part in parts:
        found = [(category, searches(described(part, category, params), params.near)) for category in classes_of(part)]
        found = [(category, searched) for category, searched in found if len(searched)]
        if not found:
            raise ValueError(
                f"{part.label}: expected shapes with keypoints in common, got none; annotate at least two of a class"
            )
        each = [_row(part.label, category, searched) for category, searched in found]
        if len(each) > 1:
            means = pd.DataFrame(each).mean(numeric_only=True).to_dict()
            each.append({"descriptor": part.label, "class": "mean", **means, "searches": sum(len(s) for _, s in found)})
        rows += each
        curves.append((part.label, np.mean([_curve(searched) for _, searched in found], axis=0)))
    caption = f"Mean over classes; descriptors scaled {params.scale}, compared by Euclidean distance."
    return Result(
        "Semantic stability across shapes of a class", pd.DataFrame(rows),
        "AUC: chance that a random point of the other shape is less like the keypoint than the same keypoint there is "
        "(.5: guessing); AUC ids: the same against the other shape's other keypoints, but those that a symmetry "
        "exchanges; first 1 %: searches whose right point is in the most similar hundredth of the surface; error: "
        "median distance of the most similar point from it, or from one that a symmetry exchanges with it, longest "
        "sides.",
        [Chart(_figure(curves), caption)],
    )  # fmt: skip


def described(part: ExecutedMember, category: str, params: Parameters) -> list[Described]:
    """The annotated shapes of a class."""
    found = []
    for entry, shape, features in part.described():
        if entry.shape.category == category and entry.keypoints is not None and len(entry.keypoints.ids):
            at = keypoint_candidates(entry.keypoints, shape, entry.shape.name)
            scaled = scale_features(features.features, params.scale, features.observed)
            found.append(Described(entry.keypoints, shape.points, scaled, at))
    return found


def searches(shapes: list[Described], near: float) -> pd.DataFrame:
    """Every keypoint of each shape looked for on each other shape that has it: a row a search.

    points: share of the other shape's wrong points that are nearer in descriptor space than the right one; ids: of its
    wrong keypoints (NaN where it has none); error: distance of the nearest point in descriptor space from the right
    one, or from one that the shape's symmetry exchanges with it, unit frame.
    """
    rows: list[pd.DataFrame] = []
    for one, other in permutations(shapes, 2):
        ids, mine, theirs = np.intersect1d(one.keypoints.ids, other.keypoints.ids, return_indices=True)
        if not len(ids):
            continue
        distances = _distances(one.features[one.at[mine]], other.features)
        right = other.at[theirs]
        expected = distances[np.arange(len(ids)), right]
        wrong, elsewhere = distances.copy(), distances[:, other.at]
        first, error = distances.argmin(axis=1), np.zeros(len(ids))
        for row, place in enumerate(theirs):
            mates = other.mates(int(place))
            gaps = np.linalg.norm(other.points[:, None] - other.points[other.at[mates]], axis=2).min(axis=1)
            wrong[row, gaps <= near] = np.nan
            elsewhere[row, mates] = np.nan
            error[row] = gaps[first[row]]
        columns = {
            "id": ids,
            "points": nearer_share(expected, wrong),
            "ids": nearer_share(expected, elsewhere),
            "error": error,
        }
        rows.append(pd.DataFrame(columns))
    return (
        pd.concat(rows, ignore_index=True) if rows else pd.DataFrame({"id": [], "points": [], "ids": [], "error": []})
    )


def _distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(k, n) Euclidean distances between rows of a (k, channel) and b (n, channel)."""
    from scipy.spatial.distance import cdist

    return np.asarray(cdist(a.astype(np.float64), b.astype(np.float64)))


def _row(label: str, category: str, searched: pd.DataFrame) -> dict[str, object]:
    return {
        "descriptor": label, "class": category, "AUC": 1 - searched["points"].mean(),
        "AUC sd": searched["points"].std(),
        "AUC ids": 1 - searched["ids"].mean(), "first 1 %": float((searched["points"] <= 0.01).mean()),
        "error": searched["error"].median(),
        "searches": len(searched),
    }  # fmt: skip


def _curve(searched: pd.DataFrame) -> np.ndarray:
    """For each share of the surface, the share of searches whose right point is within it."""
    found: np.ndarray = (searched["points"].to_numpy()[:, None] <= SHARES).mean(axis=0)
    return found


def _figure(curves: list[tuple[str, np.ndarray]]) -> go.Figure:
    figure = go.Figure()
    for place, (label, curve) in enumerate(curves):
        figure.add_scatter(
            x=(100 * SHARES).tolist(),
            y=curve.tolist(),
            name=label,
            mode="lines",
            line={"color": class_color(place), "width": 2.5},
            hovertemplate="%{y:.0%} within the most similar %{x:.2g} %<extra>" + label + "</extra>",
        )
    dotted = {"color": SOFT, "dash": "dot"}
    figure.add_scatter(
        x=(100 * SHARES).tolist(), y=SHARES.tolist(), name="guessing", mode="lines", line=dotted, hoverinfo="skip"
    )
    figure.update_xaxes(type="log", tickvals=[0.1, 0.3, 1, 3, 10, 30, 100])
    figure.update_yaxes(range=[0, 1.01], tickformat=".0%")
    return finish(figure, "most similar part of the surface, %", "keypoints whose right point is in it")
