"""`b23d scores`: the score table of a run; the same table ends `b23d run` and is kept as `runs/<name>/scores.json`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from pipeline.run import Report, Run
from schemas.scores import ScoreTable


def scores(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run file (TOML).")],
    set: Annotated[list[str], typer.Option("--set", metavar="a.b=value")] = [],  # noqa: B006
    store: Annotated[str | None, typer.Option("--store", metavar="PATH|URL")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False,
) -> None:
    """IoU per threshold and class with AUC, labelled PCK and the ceiling; mean ± sd over draws of shots."""
    from stages.scoring.table import render

    table = run_scores(Run.load(run, set, store))
    if as_json:
        print(table.model_dump_json(indent=1))
    else:
        console = Console()
        (console if console.is_terminal else Console(width=120)).print(render(table))


def run_scores(run: Run) -> ScoreTable:
    """The score table of what a run has scored so far. Raises ValueError where nothing is scored yet."""
    from schemas.keypoints import ShapeScore
    from stages.scoring.summary import score_table

    found = ((s.category, draw, s.id, a) for s, draw, a in run.collect("score") if isinstance(a, ShapeScore) and draw is not None)
    rows = list(found)
    if not rows:
        raise ValueError(f"run {run.name}: expected scored shapes, got none; run it first, or annotate shapes that are not shots")
    return score_table(run.name, rows[0][3].protocol, rows)


def after_run(run: Run, report: Report, console: Console) -> None:
    """Print the score table after a run, and keep it as JSON beside the run's manifest."""
    from stages.scoring.table import render

    if "score" not in run.config.stages:
        return
    try:
        table = run_scores(run)
    except ValueError:
        return
    (run.folder / "scores.json").write_text(table.model_dump_json(indent=1))
    console.print(render(table))
