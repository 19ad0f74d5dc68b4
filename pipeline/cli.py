"""The command line. Verbs that know 3D (scores, report, …) are plugged in by the entry-point group `b23d.commands`."""

from __future__ import annotations

import json
import signal
import sys
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.errors import B23dError

app = typer.Typer(
    name="b23d",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Few-shot 3D keypoints and back-projected 2D features for whole data sets.",
)
SHOWN = 12  # problems that `plan` prints

console = Console()
if not console.is_terminal:
    console = Console(width=120)  # into a file or a pipe, tables keep their columns

RunPath = Annotated[Path, typer.Argument(metavar="RUN", help="Run file (TOML).", show_default=False)]
Set = Annotated[
    list[str], typer.Option("--set", metavar="a.b=value", help="Override anything the run file says; repeatable.")
]
StoreUrl = Annotated[str | None, typer.Option("--store", metavar="PATH|URL", help="Another store than the run file's.")]
Limit = Annotated[int | None, typer.Option("--limit", min=1, help="Only each class's first N shapes as targets.")]
Json = Annotated[bool, typer.Option("--json", help="Machine-readable.")]
Draw = Annotated[int | None, typer.Option("--draw", help="Which draw of shots; default: the first that has it.")]


@app.callback()
def options(debug: Annotated[bool, typer.Option("--debug", help="Show tracebacks.")] = False) -> None:
    global _debug
    _debug = debug


_debug = False


@app.command()
def run(
    run: RunPath,
    set: Set = [],
    workers: Annotated[
        int | None, typer.Option(min=0, help="Worker processes; 0: run in this process. Default: one a core.")
    ] = None,
    scheduler: Annotated[str | None, typer.Option(metavar="URL", help="An existing dask cluster, tcp://…")] = None,
    store: StoreUrl = None,
    limit: Limit = None,
) -> None:
    """Do what is missing, and nothing else. Exit code 1 when shapes failed; the next run retries only those."""
    from b23d.pipeline.progress import RunProgress, stage_table
    from b23d.pipeline.run import Run

    loaded = Run.load(run, set, store)
    with RunProgress(console) as progress:
        report = loaded.execute(workers, scheduler, limit, progress.watch, progress.start)
    if report.done:
        console.print(stage_table(report))
    else:
        console.print(
            f"nothing to do: {loaded.name} is complete" if report.ok else "nothing could be done", highlight=False
        )
    for hook in entry_points(group="b23d.after_run"):
        hook.load()(loaded, report, console)
    if not report.ok:
        counts = f"[red]{len(report.failures)} failed, {report.blocked} blocked behind them[/]"
        console.print(f"{counts}; the rest is done. The next run retries only these:", highlight=False)
        for failure in report.failures:
            console.print(f"  [red]✗[/] {failure.stage}: {escape(failure.error)}", highlight=False, soft_wrap=True)
            if _debug and failure.traceback:
                console.print(escape(failure.traceback), highlight=False)
        raise typer.Exit(1)
    console.print(
        f"[dim]{len(report.done)} tasks in {report.seconds:.1f} s; store {loaded.store.url}[/]", highlight=False
    )


@app.command()
def plan(
    run: RunPath,
    set: Set = [],
    store: StoreUrl = None,
    limit: Limit = None,
    as_json: Json = False,
    exit_code: Annotated[bool, typer.Option("--exit-code", help="Exit 1 when work is pending.")] = False,
) -> None:
    """What would run, per stage: RUN / CACHED / BLOCKED, with projected bytes and seconds. Nothing is executed."""
    from b23d.pipeline.projection import project
    from b23d.pipeline.run import Run

    loaded = Run.load(run, set, store)
    planned = loaded.plan(limit)
    stages = project(loaded, planned)
    if as_json:
        print(json.dumps({"stages": stages, "problems": [problem.error for problem in planned.problems]}, indent=1))
    else:
        table = Table(title=f"plan of {loaded.name}", title_justify="left")
        for column in ("stage", "RUN", "CACHED", "BLOCKED", "MB", "CPU s"):
            table.add_column(column, justify="left" if column == "stage" else "right")
        for stage, row in stages.items():
            name = f"{stage} [dim](transient)[/]" if row["transient"] else stage
            counts = [str(row[key]) if row[key] else "·" for key in ("run", "cached", "blocked")]
            table.add_row(name, *counts, _round(row["bytes"], 1e6), _round(row["seconds"], 1))
        console.print(table)
        console.print("[dim]MB and seconds are projected from this store's history; ? where a stage has never run[/]")
        for problem in planned.problems[:SHOWN]:
            console.print(f"[red]✗[/] {escape(problem.error)}", highlight=False, soft_wrap=True)
        if len(planned.problems) > SHOWN:
            console.print(f"… and {len(planned.problems) - SHOWN} more problems", highlight=False)
    if exit_code and any(row["run"] or row["blocked"] for row in stages.values()):
        raise typer.Exit(1)


@app.command()
def show(
    run: RunPath,
    shape: str,
    stage: str,
    set: Set = [],
    store: StoreUrl = None,
    draw: Draw = None,
    export: Annotated[
        Path | None, typer.Option(help="Write it: .npz, .ply, .glb, .png, .parquet (what the artifact allows).")
    ] = None,
    picture: Annotated[
        bool | None, typer.Option("--picture/--no-picture", show_default=False, help="Default: in a terminal.")
    ] = None,
) -> None:
    """What an artifact holds: a picture, arrays, ranges, provenance."""
    from b23d.pipeline.inspection import artifact_tables, export_artifact, thumbnail
    from b23d.pipeline.run import Run

    loaded = Run.load(run, set, store)
    if export is not None:
        export_artifact(loaded, shape, stage, draw, export)
        console.print(f"wrote {export} ({export.stat().st_size / 1e6:.2f} MB)", highlight=False)
    else:
        for part in artifact_tables(loaded, shape, stage, draw):
            console.print(part)
        if console.is_terminal if picture is None else picture:
            console.print(thumbnail(loaded, shape, stage, draw, console.width) or "")


@app.command()
def explain(
    run: RunPath,
    shape: str,
    stage: str,
    set: Set = [],
    store: StoreUrl = None,
    draw: Draw = None,
    against: Annotated[
        Path | None, typer.Option(metavar="RUN2", help="Compare with this run, not the nearest artifact.")
    ] = None,
) -> None:
    """What an artifact's address is made of, and the first field that differs from the nearest stored one."""
    from b23d.pipeline.explain import explain as explain_node
    from b23d.pipeline.run import Run

    loaded = Run.load(run, set, store)
    told = explain_node(loaded, shape, stage, draw, Run.load(against, (), store) if against else None)
    title = f"{told.stage} of {told.shape}: {told.state.upper()}, address {told.address[:16]}"
    table = Table("part", "value", title=title, title_justify="left")
    for part in told.parts:
        table.add_row(part.name, escape(part.value))
    console.print(table)
    where = f"run {against}" if against else "the nearest stored artifact"
    if told.nearest is None:
        console.print(f"{told.stage} has made nothing of {told.shape} in this store yet")
    elif told.nearest == told.address:
        console.print(f"the same as in {where}" if against else "stored under this very address")
    else:
        console.print(f"differs from {where} ({told.nearest[:16]}) first in:", highlight=False)
        for difference in told.differences:
            console.print(f"  [bold]{escape(str(difference))}[/]", highlight=False)


@app.command()
def verify(run: RunPath, set: Set = [], store: StoreUrl = None) -> None:
    """Check every digest. Damaged artifacts are named with their shapes and removed, so that the next run makes them
    again."""
    from b23d.pipeline.run import Run
    from b23d.pipeline.upkeep import verify as find_damage

    loaded, count = Run.load(run, set, store), 0
    with console.status("checking") as status:
        for damage in find_damage(loaded, lambda done, total: status.update(f"checking {done}/{total}")):
            count += 1
            console.print(
                f"[red]✗[/] {damage.stage} of {', '.join(damage.shapes)}: {escape('; '.join(damage.problems))}",
                highlight=False,
            )
    if count:
        console.print(f"{count} damaged artifacts removed; `b23d run {run}` makes them again", highlight=False)
        raise typer.Exit(1)
    console.print("every artifact is what was written")


@app.command()
def gc(
    runs: Annotated[
        list[Path] | None, typer.Argument(metavar="[RUN]…", help="Run files that count besides those the store knows.")
    ] = None,
    store: Annotated[str, typer.Option("--store", metavar="PATH|URL")] = "runs/.store",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would go.")] = False,
) -> None:
    """Drop what no run file reaches, largest first. Run files that have used the store count, and those in runs/."""
    from b23d.pipeline.index import Index
    from b23d.pipeline.store import Store
    from b23d.pipeline.upkeep import garbage, reached

    opened = Store(store)
    known = Index(Path(opened.root) / "index.sqlite").run_files() if opened.local and Path(opened.root).is_dir() else []
    files = {path.resolve() for path in [*known, *(runs or [])]}
    besides = {path.resolve() for path in Path("runs").rglob("*.toml")} - files
    lost = garbage(opened, reached(sorted(files), opened, sorted(besides)))
    for item in lost:
        console.print(f"{item.stored_bytes / 1e6:10.2f} MB  {item.stage} {item.address[:16]}", highlight=False)
        if not dry_run:
            opened.delete(item.stage, item.address)
    total = sum(item.stored_bytes for item in lost) / 1e6
    verb = "would drop" if dry_run else "dropped"
    console.print(
        f"{verb} {len(lost)} artifacts, {total:.1f} MB; {len(files | besides)} run files count", highlight=False
    )


def _round(value: float | None, unit: float) -> str:
    return "?" if value is None else f"{value / unit:,.1f}" if value else "·"


def plug_in() -> None:
    """Add the commands of the entry-point group `b23d.commands`."""
    known = {command.name for command in app.registered_commands}
    for plugin in sorted(entry_points(group="b23d.commands"), key=lambda plugin: plugin.name):
        if plugin.name not in known:
            app.command(plugin.name)(plugin.load())


def main(arguments: list[str] | None = None) -> None:
    """Entry point of `b23d`: errors are printed as one line, without a traceback."""
    plug_in()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    try:
        app(args=arguments)
    except KeyboardInterrupt:
        Console(stderr=True).print("interrupted; what was finished is stored, run again to go on")
        sys.exit(130)
    except (B23dError, OSError, ValueError, KeyError, RuntimeError) as error:
        if _debug:
            raise
        message: Any = error.args[0] if isinstance(error, KeyError) and error.args else error
        Console(stderr=True).print(f"[red]error:[/] {escape(str(message))}", highlight=False, soft_wrap=True)
        sys.exit(2)


if __name__ == "__main__":
    main()
