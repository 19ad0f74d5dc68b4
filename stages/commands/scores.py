"""`b23d scores`: the score table of a run; the same table ends `b23d run` and is kept as `runs/<name>/scores.json`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from pipeline.run import Report, Run
from schemas.scores import ScoreTable

if TYPE_CHECKING:
    from stages.scoring.summary import Row


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
    from stages.scoring.summary import score_table

    rows = score_rows(run)
    return score_table(run.name, rows[0][3].protocol, rows)


def score_rows(run: Run, limit: int | None = None) -> list[Row]:
    """Class, draw, shape and score of what a run has scored so far; `limit`: as `Run.plan`'s. Raises ValueError where that is nothing."""
    from schemas.keypoints import ShapeScore

    wanted = None if limit is None else {(node, draw) for stage, node, draw in run.plan(limit).by_shape if stage == "score"}
    rows: list[Row] = [
        (shape.category, draw, shape.id, found)
        for shape, draw, found in run.collect("score")
        if isinstance(found, ShapeScore) and draw is not None and (wanted is None or (shape.name, draw) in wanted)
    ]
    if not rows:
        raise ValueError(f"run {run.name}: expected scored shapes, got none; run it first, or annotate shapes that are not shots")
    return rows


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
