"""`b23d scores`: the score table of a run; the same table ends `b23d run` and is kept as `runs/<name>/scores.json`."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.table import Table

from b23d.pipeline.run import Report, Run
from b23d.pipeline.verbs.options import Json, RunPath, Set, StoreUrl
from b23d.schemas.scores import ScoreTable
from b23d.stages.workbench.results.scores import coverage, run_scores


def scores(
    run: RunPath,
    set: Set = [],
    store: StoreUrl = None,
    as_json: Json = False,
) -> None:
    """IoU per threshold and class, AUC, PCK (labelled, symmetric, either front), ceiling; mean ± sd over draws."""
    from b23d.stages.scoring.table import render

    loaded = Run.load(run, set, store)
    table = run_scores(loaded)
    if as_json:
        print(table.model_dump_json(indent=1))
    else:
        console = Console()
        (console if console.is_terminal else Console(width=140)).print(render(table, coverage(loaded, "score")))


def recorded(result: dict[str, Any]) -> Table:
    """The table that a record holds, drawn again. Raises ValueError where it is of another version."""
    from b23d.stages.scoring.table import render

    return render(ScoreTable.model_validate(result))


def after_run(run: Run, report: Report, console: Console) -> dict[str, Any] | None:
    """Print the score table after a run, and keep it as JSON beside the run's manifest
    and in its record."""
    from b23d.stages.scoring.table import render

    if "score" not in run.config.stages:
        return None
    try:
        table = run_scores(run, report.selection)
    except ValueError:
        return None
    if not report.selection.narrows:
        (run.folder / "scores.json").write_text(table.model_dump_json(indent=1))
    console.print(render(table, coverage(run, "score", report.selection)))
    return table.model_dump(mode="json")
