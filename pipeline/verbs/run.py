"""`b23d run`."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape

from b23d.pipeline.verbs.options import (
    Classes,
    Force,
    Limit,
    OnlyFailed,
    Set,
    Shapes,
    Stages,
    StoreUrl,
    Until,
    Workers,
)
from b23d.pipeline.verbs.terminal import console, debug

SHOWN = 12  # warnings that are printed


def run(
    run: Annotated[Path | None, typer.Argument(metavar="RUN", help="Run file (TOML).", show_default=False)] = None,
    set: Set = [],
    workers: Workers = None,
    scheduler: Annotated[str | None, typer.Option(metavar="URL", help="An existing dask cluster, tcp://…")] = None,
    store: StoreUrl = None,
    shape: Shapes = [],
    category: Classes = [],
    limit: Limit = None,
    stage: Stages = [],
    until: Until = None,
    only_failed: OnlyFailed = False,
    force: Force = False,
    again: Annotated[
        str | None,
        typer.Option("--again", metavar="ID", help="A recorded run, as it was.", show_default=False),
    ] = None,
) -> None:
    """Do what is missing, and nothing else. Exit code 1 when shapes failed; the next run retries only those."""
    from b23d.pipeline.again import run_of
    from b23d.pipeline.history import attach
    from b23d.pipeline.progress import RunProgress, spared, stage_table
    from b23d.pipeline.run import Run
    from b23d.pipeline.selection import Selection

    selection = Selection(tuple(shape), tuple(category), limit, tuple(stage), until, only_failed, force)
    if (run is None) == (again is None):
        raise typer.BadParameter("expected a run file, or --again with the id of a record: one of the two")
    loaded = Run.load(run, set, store) if run is not None else run_of(str(again), set, store)
    with RunProgress(console) as progress:
        report = loaded.execute(workers, scheduler, selection, progress.watch, progress.start)
    if report.done:
        console.print(stage_table(report))
    if report.spared:
        console.print(spared(report), highlight=False)
    if not report.done and not report.spared:
        console.print(
            f"nothing to do: {loaded.name} is complete" if report.ok else "nothing could be done", highlight=False
        )
    for hook in entry_points(group="b23d.after_run"):
        table = hook.load()(loaded, report, console)
        if table is not None:
            attach(loaded.store, report.record, hook.name, table)
    for line in report.warnings[:SHOWN]:
        console.print(f"[yellow]![/] {escape(line)}", highlight=False, soft_wrap=True)
    if len(report.warnings) > SHOWN:
        console.print(f"… and {len(report.warnings) - SHOWN} more warnings", highlight=False)
    if not report.ok:
        counts = f"[red]{len(report.failures)} failed, {report.blocked} blocked behind them[/]"
        console.print(f"{counts}; the rest is done. The next run retries only these:", highlight=False)
        for failure in report.failures:
            console.print(f"  [red]✗[/] {failure.stage}: {escape(failure.error)}", highlight=False, soft_wrap=True)
            if debug.on and failure.traceback:
                console.print(escape(failure.traceback), highlight=False)
        raise typer.Exit(1)
    console.print(
        f"[dim]{len(report.done)} tasks in {report.seconds:.1f} s; store {loaded.store.url}[/]", highlight=False
    )
