"""`b23d sweep`: one parameter over several values, or named variants of a run, everything else as the run file says.

    [sweep]
    "stages.optimize.alpha" = [0, 0.25, 1, 4]

    [variants.HKS]
    "feeds.backproject" = "describe"
    "stages.describe.descriptor" = "hks"
"""

from __future__ import annotations

from itertools import groupby
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from pipeline.config import load_config
from pipeline.errors import RunFileError
from stages.commands.series import members, run_series, series_plot, series_table


def sweep(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run file; its [sweep] and [variants] tables say what is run.")],
    set: Annotated[list[str], typer.Option("--set", metavar="a.b=value", help="Fixed throughout.")] = [],  # noqa: B006
    store: Annotated[str | None, typer.Option("--store", metavar="PATH|URL")] = None,
    workers: Annotated[int | None, typer.Option(min=0)] = None,
    limit: Annotated[int | None, typer.Option("--limit", min=1)] = None,
) -> None:
    """Score every value of the fields in the run file's sweep table, and every variant: tables, and plots in the run's folder."""
    console, config = Console(), load_config(run, set)
    listed = members(config)
    if not listed:
        raise RunFileError(
            f"run file {run}: expected a [sweep] or [variants] table, got none; add one, or --set 'sweep={{\"a.b\" = [1, 2]}}'"
        )
    for series, group in groupby(listed, key=lambda member: member.series):
        found = run_series(console, run, group, store, workers, limit)
        console.print(series_table(series, found))
        path = run.parent / config.file.name / f"sweep-{series.split('.')[-1]}.html"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(series_plot(found))
        console.print(f"plot: {path}", highlight=False)
