"""`b23d run`."""

from __future__ import annotations

import json
from collections import Counter
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape

from b23d.pipeline.verbs.options import (
    Classes,
    Force,
    Json,
    Limit,
    OnlyFailed,
    Quiet,
    Set,
    Shapes,
    Stages,
    StoreUrl,
    Until,
    Verbose,
    Workers,
)
from b23d.pipeline.verbs.terminal import console, debug
from b23d.schemas.wording import counted

if TYPE_CHECKING:
    from b23d.pipeline.run import Run
    from b23d.pipeline.scheduling.execution import Report

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
    quiet: Quiet = False,
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Do what is missing, and nothing else. Exit code 1 when shapes failed; the next run retries only those."""
    from b23d.pipeline.inspection.again import run_of, selected_in
    from b23d.pipeline.planning.selection import EVERYTHING, Selection
    from b23d.pipeline.run import Run
    from b23d.pipeline.scheduling.progress import RunProgress, failed

    selection = Selection(tuple(shape), tuple(category), limit, tuple(stage), until, only_failed, force)
    if (run is None) == (again is None):
        raise typer.BadParameter("expected a run file, or --again with the id of a record: one of the two")
    loaded = Run.load(run, set, store) if run is not None else run_of(str(again), set, store)
    if again is not None and selection == EVERYTHING:
        selection = selected_in(again, store)
    console.quiet = quiet or as_json
    try:
        with RunProgress(console, verbose=verbose, tracebacks=debug.on) as progress:
            report = loaded.execute(workers, scheduler, selection, progress.watch, progress.start)
        _tell(loaded, report)
    finally:
        console.quiet = False
    if as_json:
        print(json.dumps(_as_json(loaded, report), indent=1))
    elif not report.ok:
        console.print(f"[red]{failed(report)}[/]", highlight=False)
        for failure in report.failures:
            progress.fail(failure)
    if not report.ok:
        raise typer.Exit(1)


def _tell(loaded: Run, report: Report) -> None:
    from b23d.pipeline.inspection.unannotated import unannotated_notes
    from b23d.pipeline.records.history import attach
    from b23d.pipeline.scheduling.progress import spared, stage_table

    if report.done:
        console.print(stage_table(report))
    if report.spared:
        console.print(spared(report), highlight=False)
    if not report.done and not report.spared:
        asked = report.selection.words
        there = f"of {loaded.name}, all that {asked} selects is there" if asked else f"{loaded.name} is complete"
        if report.selection.only_failed:
            there = f"{asked} selects nothing of {loaded.name}: no such shape failed before"
        if report.ok:
            reason = _no_targets(loaded, report) or f"nothing to do: {there}"
            console.print(reason, highlight=False, markup=False, soft_wrap=True)
    if report.plan is not None:
        for note in unannotated_notes(loaded, report.plan):
            console.print(f"[yellow]![/] {escape(note)}", highlight=False, soft_wrap=True)
    for hook in entry_points(group="b23d.after_run"):
        table = hook.load()(loaded, report, console)
        if table is not None:
            attach(loaded.store, report.record, hook.name, table)
    for line in report.warnings[:SHOWN]:
        console.print(f"[yellow]![/] {escape(line)}", highlight=False, soft_wrap=True)
    if len(report.warnings) > SHOWN:
        console.print(f"… and {counted(len(report.warnings) - SHOWN, 'more warning')}", highlight=False)
    if report.ok:
        said = f"{counted(len(report.done), 'task')} in {report.seconds:.1f} s; store {loaded.store.url}"
        console.print(f"[dim]{escape(said)}[/]", highlight=False)


def _no_targets(loaded: Run, report: Report) -> str:
    """Why nothing of what was selected is predicted: it is the shots; "" where something is."""
    if not report.selection.narrows:
        return ""
    plan, chosen = loaded.plan(report.selection), report.selection.targets(loaded.shapes)
    if not {stage for stage, _, draw in loaded.plan().by_shape if draw is not None} & {*plan.stages}:
        return ""  # nothing was asked for that shots come into
    shots = {shot.name for draw in plan.draws for shot in draw.shots}
    seen = {name for stage, name, draw in plan.by_shape if draw is not None}
    if not chosen or chosen & seen or not chosen <= shots:
        return ""
    names = ", ".join(sorted(chosen)[:5])
    return f"nothing to predict: {names} are shots of every draw; select others, or raise --limit"


def _as_json(loaded: Run, report: Report) -> dict[str, Any]:
    return {
        "run": loaded.name,
        "ok": report.ok,
        "selected": report.selection.words,
        "done": Counter(outcome.stage for outcome in report.done),
        "failures": [{"stage": f.stage, "shape": f.shape, "error": f.error} for f in report.failures],
        "blocked": report.blocked,
        "seconds": round(report.seconds, 2),
        "store": loaded.store.url,
    }
