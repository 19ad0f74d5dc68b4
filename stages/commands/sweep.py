"""`b23d sweep`: one parameter over several values, everything else as the run file says.

    [sweep]
    "stages.optimize.alpha" = [0, 0.25, 1, 4]
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from pipeline.config import load_config
from pipeline.errors import RunFileError
from stages.commands.series import Member, run_series, series_plot, series_table


def sweep(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run file; its [sweep] table says what is swept.")],
    set: Annotated[list[str], typer.Option("--set", metavar="a.b=value", help="Fixed throughout.")] = [],  # noqa: B006
    store: Annotated[str | None, typer.Option("--store", metavar="PATH|URL")] = None,
    workers: Annotated[int | None, typer.Option(min=0)] = None,
    limit: Annotated[int | None, typer.Option("--limit", min=1)] = None,
) -> None:
    """Score every value of the fields that the run file's sweep table lists: a table, and a plot in the run's folder."""
    console, file = Console(), load_config(run, set).file
    if not file.sweep:
        raise RunFileError(f"run file {run}: expected a [sweep] table, got none; add one, or --set 'sweep={{\"a.b\" = [1, 2]}}'")
    for field, values in file.sweep.items():
        name = f"name={file.name}.sweep"
        members = [Member(f"{field} = {json.dumps(value)}", (*set, f"{field}={json.dumps(value)}", name)) for value in values]
        found = run_series(console, run, members, store, workers, limit)
        console.print(series_table(field, found))
        path = run.parent / file.name / f"sweep-{field.split('.')[-1]}.html"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(series_plot(found))
        console.print(f"plot: {path}", highlight=False)
