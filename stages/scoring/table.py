"""A score table for the terminal."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table

from b23d.schemas.scores import ClassScores, ScoreTable
from b23d.schemas.wording import averaged

SHOWN = (0.0, 0.02, 0.05, 0.10)
"""Thresholds worth a column, where the run has them."""


def render(table: ScoreTable, coverage: str = "") -> Table:
    """One row a class and one for their mean: IoU at a few thresholds, AUC, PCK at the largest one (as annotated, after
    permitted exchanges, with either front), ceiling; ± sd over draws. `coverage`: of how many targets, where that is
    not all of them."""
    thresholds = table.mean.thresholds
    shown = [i for i, threshold in enumerate(thresholds) if any(abs(threshold - wanted) < 1e-9 for wanted in SHOWN)]
    shown = shown or [len(thresholds) - 1]
    largest = f"{thresholds[-1]:g}"
    exact = " IoU 0 counts predictions on the very annotated point." if 0.0 in [thresholds[i] for i in shown] else ""
    result = Table(
        title=escape(f"{table.run} ({coverage})" if coverage else table.run),
        caption=f"IoU at {table.protocol}; {averaged(table.mean.draws)}.{exact} "
        "Either front: PCK if a shape's front were free to be opposite; PCK is lower by what choosing it costs. "
        "Ceiling: IoU if every id of the shots were in its place.",
    )
    result.add_column("class")
    result.add_column("targets", justify="right")
    columns = [f"IoU {thresholds[i]:g}" for i in shown]
    for name in (*columns, "AUC", f"PCK {largest}", f"sym. PCK {largest}", "either front", "ceiling"):
        result.add_column(name, justify="right")
    for name, scores in table.classes.items():
        result.add_row(escape(name), *_cells(scores, shown))
    if len(table.classes) > 1:
        result.add_section()
        result.add_row("mean", *_cells(table.mean, shown), style="bold")
    return result


def _cells(scores: ClassScores, shown: list[int]) -> list[str]:
    pairs = [(scores.iou.mean[i], scores.iou.sd[i]) for i in shown]
    pairs.append((scores.auc.mean, scores.auc.sd))
    pairs += [(curve.mean[-1], curve.sd[-1]) for curve in (scores.pck, scores.symmetric_pck, scores.either_front_pck)]
    return [
        str(scores.targets),
        *(_figure(mean, sd, scores.draws) for mean, sd in pairs),
        _figure(scores.ceiling, 0, 1),
    ]


def _figure(mean: float, sd: float, draws: int) -> str:
    """ ".712 ±.031", and no spread where there is one draw."""
    return _short(mean) + (f" ±{_short(sd)}" if draws > 1 else "")


def _short(value: float) -> str:
    return f"{value:.3f}".removeprefix("0")
