"""shots: does annotating more help on these shapes? Scores against the number of annotated shapes."""

from __future__ import annotations

from collections import defaultdict
from typing import Literal

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from b23d.schemas.scores import ClassScores, ShapeScore
from b23d.schemas.wording import averaged, counted
from b23d.stages.scoring.summary import score_table
from b23d.stages.workbench.analyses.drawing import add_band, finish
from b23d.stages.workbench.analyses.interface import AnalysisParams, Chart, ExecutedMember, Result, classes_of
from b23d.stages.workbench.pictures.palette import class_color

MEAN = "mean"
FIGURES = ("AUC", "PCK")
Scored = dict[tuple[str, int, str], ShapeScore]
"""Class, draw and name of a target → its score."""


class Parameters(AnalysisParams):
    kind: Literal["shots"]


def needs(params: Parameters) -> list[str]:
    return ["normalize", "score"]


def analyse(parts: list[ExecutedMember], params: Parameters) -> Result:
    """Raises ValueError where members do not differ in the number of shots, or have no target in common."""
    scored = {_count(part): _scored(part) for part in parts}
    if len(scored) < 2 or len(scored) < len(parts):
        raise ValueError(
            f"{parts[0].run.config.file.name}: expected members of different shots.count, got "
            f'{[_count(part) for part in parts]}; give [sweep] "shots.count" = [1, 3, 10], say'
        )
    common = set.intersection(*map(set, scored.values()))
    if not common:
        raise ValueError(
            f"{parts[0].run.config.file.name}: expected targets that are no shot of any draw of up to "
            f"{counted(max(scored), 'shot')}, got none; annotate more shapes, or take fewer shots"
        )
    each = pd.concat([_figures(count, scored[count], common) for count in sorted(scored)], ignore_index=True)
    table = _table(each, common)
    return Result(
        "Does annotating more help?", table,
        "shots: annotated shapes of each class; every row is of the same targets, those that no row's shots are among. "
        "AUC: mean IoU over thresholds 0 … .10; PCK: keypoints whose own id is found within .10; "
        f"{averaged(int(table['draws'].max()))}. more: what the row has over the one before, in the same draws."
        + _left_out(parts, common),
        [Chart(_curves(table), _words(table))],
    )  # fmt: skip


def _count(part: ExecutedMember) -> int:
    return part.run.config.file.shots.count


def _scored(part: ExecutedMember) -> Scored:
    return {
        (entry.shape.category, attempt.draw, name): attempt.score
        for name, entry in part.entries.items()
        for attempt in entry.attempts
        if attempt.score is not None
    }


def _left_out(parts: list[ExecutedMember], common: set[tuple[str, int, str]]) -> str:
    """The classes that have no target in common, in words; nothing where there are none."""
    shown = {category for category, _, _ in common}
    missing = sorted({category for part in parts for category in classes_of(part)} - shown)
    told = ", ".join(missing)
    return f" Left out, as no target of theirs has a score in every row: {told}." if missing else ""


def _figures(count: int, scored: Scored, common: set[tuple[str, int, str]]) -> pd.DataFrame:
    """A row a draw and class, and their mean where there are several: its figures on the common targets."""
    draws = defaultdict(list)
    for category, draw, name in sorted(common):
        draws[draw].append((category, draw, name, scored[category, draw, name]))
    rows = []
    for draw, members in draws.items():
        table = score_table("", None, members)
        classes: dict[str, ClassScores] = {**table.classes, **({MEAN: table.mean} if len(table.classes) > 1 else {})}
        rows += [
            {"shots": count, "class": name, "draw": draw, "AUC": one.auc.mean, "PCK": one.pck.mean[-1]}
            for name, one in classes.items()
        ]
    return pd.DataFrame(rows)


def _table(each: pd.DataFrame, common: set[tuple[str, int, str]]) -> pd.DataFrame:
    targets = pd.DataFrame(sorted(common), columns=["class", "draw", "name"])
    rows: list[dict[str, object]] = []
    for category, members in each.groupby("class", sort=False):
        own = targets if category == MEAN else targets[targets["class"] == category]
        before: pd.DataFrame | None = None
        for count, draws in members.set_index("draw").groupby("shots"):
            row: dict[str, object] = {"class": category, "shots": count}
            for figure in FIGURES:
                gain = None if before is None else draws[figure] - before[figure]
                row |= {figure: draws[figure].mean(), f"{figure} sd": _sd(draws[figure])}
                row |= {
                    f"{figure} more": np.nan if gain is None else gain.mean(),
                    f"{figure} more sd": np.nan if gain is None else _sd(gain),
                }
            rows.append({**row, "targets": own["name"].nunique(), "draws": len(draws)})
            before = draws
    return pd.DataFrame(rows)


def _sd(values: pd.Series) -> float:
    return float(values.std(ddof=1)) if len(values) > 1 else np.nan  # one draw tells no spread


def _words(table: pd.DataFrame) -> str:
    """What the last step brought, by the mean or the only class."""
    rows = table[table["class"] == table["class"].iloc[-1]]
    before, last = rows.iloc[-2], rows.iloc[-1]
    over = averaged(int(last["draws"]))
    gains = " and ".join(
        f"{last[f'{name} more']:+.3f}{'' if np.isnan(sd := last[f'{name} more sd']) else f' ± {sd:.3f}'} {name}"
        for name in FIGURES
    )
    return (
        f"{over[:1].upper()}{over[1:]}; solid: AUC, dotted: PCK. From {before['shots']} to "
        f"{counted(int(last['shots']), 'annotated shape')} of a class: {gains} ({last['class']})."
    )


def _curves(table: pd.DataFrame) -> go.Figure:
    figure = go.Figure()
    for number, (category, rows) in enumerate(table.groupby("class", sort=False)):
        color = class_color(number)
        for name, dash in zip(FIGURES, ("solid", "dot"), strict=True):
            line = f"{category}, {name}"
            add_band(
                figure,
                rows["shots"].to_numpy(),
                rows[name].to_numpy(),
                rows[f"{name} sd"].fillna(0.0).to_numpy(),
                line,
                color,
            )
            figure.add_scatter(
                x=rows["shots"].tolist(), y=rows[name].tolist(), name=line, legendgroup=line, mode="lines+markers",
                line={"color": color, "dash": dash, "width": 4 if category == MEAN else 2},
                hovertemplate="%{y:.3f} with %{x}<extra>" + line + "</extra>",
            )  # fmt: skip
    counts = sorted(table["shots"].unique().tolist())
    figure.update_xaxes(type="log", tickvals=counts, ticktext=[str(count) for count in counts])
    figure.update_yaxes(range=[0, 1.01])
    return finish(figure, "annotated shapes of each class", "AUC, PCK", 520)
