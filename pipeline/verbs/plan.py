"""`b23d plan`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.planning.nodes import SHOTS
from b23d.pipeline.records.warned import warnings
from b23d.pipeline.verbs.options import (
    Classes,
    Force,
    Json,
    Limit,
    OnlyFailed,
    RunPath,
    Set,
    Shapes,
    Stages,
    StoreUrl,
    Until,
)
from b23d.pipeline.verbs.terminal import console
from b23d.schemas.wording import counted

if TYPE_CHECKING:
    from b23d.pipeline.planning.plan import Plan
    from b23d.pipeline.run import Run

SHOWN = 12  # problems that are printed


def plan(
    run: RunPath,
    set: Set = [],
    store: StoreUrl = None,
    shape: Shapes = [],
    category: Classes = [],
    limit: Limit = None,
    stage: Stages = [],
    until: Until = None,
    only_failed: OnlyFailed = False,
    force: Force = False,
    as_json: Json = False,
    why: Annotated[bool, typer.Option("--why", help="Why tasks are to run: what has changed, how often.")] = False,
    exit_code: Annotated[bool, typer.Option("--exit-code", help="Exit 1 when work is pending.")] = False,
) -> None:
    """What would run, per stage: RUN / CACHED / BLOCKED, with projected bytes and seconds. Nothing is executed."""
    from b23d.pipeline.inspection.projection import memory_line, project
    from b23d.pipeline.inspection.unannotated import unannotated_notes
    from b23d.pipeline.planning.draws import draw_notes
    from b23d.pipeline.planning.selection import Selection
    from b23d.pipeline.run import Run
    from b23d.pipeline.scheduling.progress import to_run

    selection = Selection(tuple(shape), tuple(category), limit, tuple(stage), until, only_failed, force)
    loaded = Run.load(run, set, store)
    planned = loaded.plan(selection)
    stages = project(loaded, planned)
    if as_json:
        print(json.dumps({"stages": stages, "problems": [problem.error for problem in planned.problems]}, indent=1))
    else:
        table = Table(title=f"plan of {loaded.name}", title_justify="left")
        for column in ("stage", "RUN", "CACHED", "BLOCKED", "MB", "CPU s", "peak MB"):
            table.add_column(column, justify="left" if column == "stage" else "right")
        for planned_stage, row in stages.items():
            name = f"{planned_stage} [dim](transient)[/]" if row["transient"] else planned_stage
            counts = [str(row[key]) if row[key] else "·" for key in ("run", "cached", "blocked")]
            table.add_row(
                name, *counts, _round(row["bytes"], 1e6), _round(row["seconds"], 1), _round(row["peak_mb"], 1)
            )
        console.print(table)
        console.print(to_run(planned), highlight=False)
        if memory := memory_line(stages, loaded.config.file.execution):
            console.print(memory, highlight=False, markup=False, soft_wrap=True)
        console.print("[dim]MB and seconds are projected from this store's history; ? where a stage has never run[/]")
        console.print(f"[dim]store: {escape(loaded.store.url)}[/]", highlight=False, soft_wrap=True)
        for note in draw_notes(planned.draws):
            console.print(f"[yellow]![/] {escape(note)}", highlight=False, soft_wrap=True)
        for note in unannotated_notes(loaded, planned):
            console.print(f"[yellow]![/] {escape(note)}", highlight=False, soft_wrap=True)
        for problem in planned.problems[:SHOWN]:
            console.print(f"[red]✗[/] {escape(problem.error)}", highlight=False, soft_wrap=True)
        if len(planned.problems) > SHOWN:
            console.print(f"… and {counted(len(planned.problems) - SHOWN, 'more problem')}", highlight=False)
        for line in warnings(loaded.folder, planned)[:SHOWN]:
            console.print(f"[yellow]![/] {escape(line)}", highlight=False, soft_wrap=True)
    if why and not as_json:
        _print_reasons(loaded, planned)
    pending = exit_code and any(row["run"] or row["blocked"] for row in stages.values())
    hopeless = planned.unannotated or any(problem.stage == SHOTS for problem in planned.problems)
    if pending or hopeless:  # no run mends that
        raise typer.Exit(1)


def _round(value: float | None, unit: float) -> str:
    return "?" if value is None else f"{value / unit:,.1f}" if value else "·"


def _print_reasons(run: Run, planned: Plan) -> None:
    from b23d.pipeline.inspection.lineage import reasons

    found, behind = reasons(run, planned)
    for reason, count in found.most_common():
        console.print(f"{count:,} × {escape(reason)}", highlight=False, soft_wrap=True)
    if behind:
        console.print(f"{behind:,} × behind these", highlight=False)
