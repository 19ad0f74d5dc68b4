"""`b23d parts`: the table of transferred part labels."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.table import Table

from b23d.pipeline.run import Report, Run
from b23d.pipeline.verbs.options import Json, RunPath, Set, StoreUrl
from b23d.schemas.scores import PartTable
from b23d.stages.workbench.results.scores import coverage, run_parts


def parts(
    run: RunPath,
    set: Set = [],
    store: StoreUrl = None,
    as_json: Json = False,
) -> None:
    """IoU of transferred parts per class (ShapeNetPart's protocol), their average; mean ± sd over draws of shots."""
    from b23d.stages.scoring.parts import render

    loaded = Run.load(run, set, store)
    table = run_parts(loaded)
    if as_json:
        print(table.model_dump_json(indent=1))
    else:
        console = Console()
        (console if console.is_terminal else Console(width=140)).print(render(table, coverage(loaded, "score_parts")))


def recorded(result: dict[str, Any]) -> Table:
    """The table that a record holds, drawn again. Raises ValueError where it is of another version."""
    from b23d.stages.scoring.parts import render

    return render(PartTable.model_validate(result))


def after_run(run: Run, report: Report, console: Console) -> dict[str, Any] | None:
    """Print the part table after a run that scores parts, and keep it as JSON beside the run's manifest
    and in its record."""
    from b23d.stages.scoring.parts import render

    if "score_parts" not in run.config.stages:
        return None
    try:
        table = run_parts(run)
    except ValueError:
        return None
    (run.folder / "parts.json").write_text(table.model_dump_json(indent=1))
    console.print(render(table, coverage(run, "score_parts")))
    return table.model_dump(mode="json")
