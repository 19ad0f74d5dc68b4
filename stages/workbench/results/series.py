"""A series of runs that differ by overrides, scored side by side as a table and a plot: what `ablate` and `sweep`
print."""

from __future__ import annotations

import json
from collections.abc import Hashable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.members import Member
from b23d.schemas.wording import counted
from b23d.stages.workbench.results.scores import spread

if TYPE_CHECKING:
    from b23d.schemas.scores import ClassScores, ScoreTable
    from b23d.stages.scoring.summary import ScoreRow


def run_series(
    console: Console, run: Path, members: Iterable[Member], store: str | None, workers: int | None, limit: int | None
) -> list[tuple[str, ScoreTable]]:
    """Execute and score every member; all that members share is computed once. Raises ValueError where a member scores
    nothing.

    Only targets that every member has scored count, so that members differ by what they do, not by whom they do it to.
    """
    from b23d.stages.scoring.summary import score_table
    from b23d.stages.workbench.results.scores import score_rows

    found: list[tuple[str, str, dict[tuple[str, Hashable, str], ScoreRow]]] = []
    for member in members:
        loaded = Run.load(run, member.overrides, store)
        with console.status(f"{escape(member.label)}: running"):
            report = loaded.execute(workers, selection=Selection(limit=limit))
        ran = (
            ", ".join(sorted({outcome.stage for outcome in report.done}, key=list(loaded.config.stages).index))
            or "nothing"
        )
        failed = f"; [red]{len(report.failures)} failed, {report.blocked} blocked[/]" if not report.ok else ""
        rows = score_rows(loaded, Selection(limit=limit))
        auc = score_table(loaded.name, None, rows).mean.auc.mean
        console.print(
            f"[dim]{escape(member.label)}: ran {ran} in {report.seconds:.0f} s, AUC {auc:.3f}[/]{failed}",
            highlight=False,
        )
        console.file.flush()  # hours of them may go to a file
        found.append((member.label, loaded.name, {row[:3]: row for row in rows}))
    shared = set.intersection(*(set(rows) for _, _, rows in found))
    if lost := max(len(rows) for _, _, rows in found) - len(shared):
        console.print(f"left out: {counted(lost, 'score')} of targets that not every step has scored", highlight=False)
    return [
        (label, score_table(name, None, [rows[key] for key in sorted(shared, key=str)])) for label, name, rows in found
    ]


def series_table(title: str, found: list[tuple[str, ScoreTable]]) -> Table:
    """Mean over classes of each member: IoU at .02, .05, .10, AUC with sd over draws, what AUC changed, labelled PCK;
    then AUC by class."""
    classes = list(found[0][1].classes)
    table = Table(title=f"{escape(title)} (mean over classes)", title_justify="left")
    for column in (
        "step",
        "IoU .02",
        ".05",
        ".10",
        "AUC",
        "Δ AUC",
        "PCK .10",
        *(f"AUC {escape(name)}" for name in classes),
    ):
        table.add_column(column, justify="left" if column == "step" else "right", overflow="fold")
    last: float | None = None
    for label, scores in found:
        mean = scores.mean
        delta = "" if last is None else f"{mean.auc.mean - last:+.3f}"
        each = [f"{scores.classes[name].auc.mean:.3f}" for name in classes]
        at = [f"{_at(mean, threshold):.3f}" for threshold in (0.02, 0.05, 0.10)]
        table.add_row(
            escape(label), *at, spread(mean.auc.mean, mean.auc.sd, mean.draws), delta, f"{mean.pck.mean[-1]:.3f}", *each
        )
        last = mean.auc.mean
    return table


def series_plot(found: list[tuple[str, ScoreTable]]) -> str:
    """The same as one self-contained HTML page: a bar of AUC a member, with the sd over draws."""
    import plotly.graph_objects as go

    names = [label for label, _ in found]
    auc = [scores.mean.auc for _, scores in found]
    spread_of = {"error_x": {"array": [a.sd for a in auc]}} if any(s.mean.draws > 1 for _, s in found) else {}
    figure = go.Figure(go.Bar(x=[a.mean for a in auc], y=names, orientation="h", **spread_of))
    height = 120 + 34 * len(found)
    figure.update_layout(
        xaxis_title="AUC of IoU, 0 … .10", yaxis={"autorange": "reversed"}, margin={"l": 360}, height=height
    )
    return str(figure.to_html(include_plotlyjs=True))


def series_json(found: list[tuple[str, ScoreTable]]) -> str:
    """All score tables, in order: [{"step", "scores"}]; `scores` as `b23d scores --json` prints them."""
    return json.dumps([{"step": label, "scores": scores.model_dump(mode="json")} for label, scores in found], indent=1)


def _at(scores: ClassScores, threshold: float) -> float:
    distance = [abs(value - threshold) for value in scores.thresholds]
    return scores.iou.mean[distance.index(min(distance))]
