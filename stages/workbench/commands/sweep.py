"""`b23d sweep`: one parameter over several values, or named variants of a run, everything else as the run file says.

    [sweep]
    "stages.reweight.sigma" = [0, 0.01, 0.05]

    [variants."descriptors/HKS"]
    "feeds.backproject" = "describe"
    "stages.describe.descriptor" = "hks"

What stands before the "/" of a variant's name is its group: one figure and one table. Variants without one stand in
every group.
"""

from __future__ import annotations

from collections.abc import Sequence
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from b23d.pipeline.errors import RunFileError
from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import load_config, refuse_unused
from b23d.pipeline.runfile.members import Member, members
from b23d.pipeline.runfile.overrides import Carried
from b23d.pipeline.verbs.options import Limit, Set, StoreUrl, Workers


def sweep(
    run: Annotated[
        Path, typer.Argument(metavar="RUN", help="Run file; its [sweep] and [variants] tables say what is run.")
    ],
    set: Set = [],
    store: StoreUrl = None,
    workers: Workers = None,
    limit: Limit = None,
    only: Annotated[
        list[str], typer.Option("--only", metavar="GLOB", help="Run only systems of such a name; repeatable.")
    ] = [],
    without: Annotated[
        list[str], typer.Option("--without", metavar="GLOB", help="Run none of these; repeatable.")
    ] = [],
) -> None:
    """Score every value of the fields in the run file's sweep table, and every variant: tables, and one comparison
    page.

    A system that cannot run here (its weights or its package are missing, say) is named with the reason, and the rest
    goes on. The page, `comparison.html` in the run's folder, shows all that is stored; `b23d report` makes it again
    without running anything.
    """
    console, config = Console(), load_config(run, map(Carried, set))
    console = console if console.is_terminal else Console(width=140)
    listed = members(config)
    if not listed:
        raise RunFileError(
            f"run file {run}: expected a [sweep] or [variants] table, got none; "
            f"add one, or --set 'sweep={{\"a.b\" = [1, 2]}}'"
        )
    chosen = choose(listed, only, without)
    if set:
        refuse_unused(set, [load_config(run, member.overrides) for member in chosen])
    for place, member in enumerate(chosen, 1):
        execute(console, run, member, f"{place}/{len(chosen)} {member.label}", store, workers, limit)
    show(console, run, set, store, limit, chosen)


def choose(listed: Sequence[Member], only: Sequence[str], without: Sequence[str]) -> list[Member]:
    """The members whose labels match one of `only` (all, if that is empty) and none of `without`. Raises ValueError
    where none is left."""
    chosen = [
        member
        for member in listed
        if (not only or any(fnmatchcase(member.label, glob) for glob in only))
        and not any(fnmatchcase(member.label, g) for g in without)
    ]
    if not chosen:
        names = ", ".join(member.label for member in listed)
        raise ValueError(
            f"--only, --without: expected to leave one of {names}, got none; quote the globs, 'encoders/*' say"
        )
    return chosen


def execute(
    console: Console, run: Path, member: Member, label: str, store: str | None, workers: int | None, limit: int | None
) -> None:
    """Run one member; what keeps it from running is printed, and is no error of the series."""
    from b23d.stages.workbench.results.comparing import UNUSABLE, reason_of

    try:
        loaded = Run.load(run, member.overrides, store)
        with console.status(f"{escape(label)}: running"):
            report = loaded.execute(workers, selection=Selection(limit=limit))
    except UNUSABLE as error:
        console.print(
            f"[yellow]{escape(label)}: unavailable: {escape(reason_of(error))}[/]", highlight=False, soft_wrap=True
        )
        return
    ran = (
        ", ".join(sorted({outcome.stage for outcome in report.done}, key=list(loaded.config.stages).index)) or "nothing"
    )
    failed = "" if report.ok else f"; [red]{len(report.failures)} failed, {report.blocked} blocked[/]"
    console.print(
        f"[dim]{escape(label)}: ran {ran} in {report.seconds:.0f} s[/]{failed}", highlight=False, soft_wrap=True
    )
    for failure in report.failures[:1]:
        console.print(f"  [red]✗[/] {failure.stage}: {escape(failure.error)}", highlight=False, soft_wrap=True)


def show(
    console: Console, run: Path, set: Sequence[str], store: str | None, limit: int | None, chosen: Sequence[Member]
) -> None:
    """Print the tables of what was chosen, and write the page of everything that is stored."""
    from b23d.stages.workbench.report.comparison import write_comparison
    from b23d.stages.workbench.report.terminal import comparison_tables
    from b23d.stages.workbench.results.comparing import compare

    config = load_config(run, map(Carried, set))
    found = compare(run, members(config), store, limit)
    for table in comparison_tables(found, {member.label for member in chosen}):
        console.print(table)
    page = write_comparison(config, found, run.parent / config.file.name)
    console.print(f"comparison: {page}, and comparison.json beside it", highlight=False, markup=False, soft_wrap=True)
