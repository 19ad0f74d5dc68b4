"""`b23d parts`: the table of transferred part labels."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from pipeline.run import Report, Run
from schemas.parts import PartTable


def parts(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run file (TOML).")],
    set: Annotated[list[str], typer.Option("--set", metavar="a.b=value")] = [],  # noqa: B006
    store: Annotated[str | None, typer.Option("--store", metavar="PATH|URL")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Machine-readable.")] = False,
) -> None:
    """IoU of transferred parts per class (ShapeNetPart's protocol), their average; mean ± sd over draws of shots."""
    from stages.scoring.parts import render

    table = run_parts(Run.load(run, set, store))
    if as_json:
        print(table.model_dump_json(indent=1))
    else:
        console = Console()
        (console if console.is_terminal else Console(width=140)).print(render(table))


def run_parts(run: Run) -> PartTable:
    """The part table of what a run has scored so far. Raises ValueError where the run scores no parts, or none is scored yet."""
    from schemas.parts import PartScore
    from stages.scoring.parts import part_table

    if "score_parts" not in run.config.stages:
        raise ValueError(f'run {run.name}: expected score_parts among its stages, got none; set outputs = ["score_parts"]')
    found = ((s.category, draw, s.id, a) for s, draw, a in run.collect("score_parts") if isinstance(a, PartScore) and draw is not None)
    return part_table(run.name, found)


def after_run(run: Run, report: Report, console: Console) -> None:
    """Print the part table after a run that scores parts, and keep it as JSON beside the run's manifest."""
    from stages.scoring.parts import render

    if "score_parts" not in run.config.stages:
        return
    try:
        table = run_parts(run)
    except ValueError:
        return
    (run.folder / "parts.json").write_text(table.model_dump_json(indent=1))
    console.print(render(table))
