"""`b23d explain`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.verbs.options import DrawOption, RunPath, Set, StoreUrl
from b23d.pipeline.verbs.terminal import console
from b23d.schemas.wording import counted

if TYPE_CHECKING:
    from b23d.pipeline.run import Run

SHOWN = 4  # shapes that a line names


def explain(
    run: RunPath,
    shape: str,
    stage: str,
    set: Set = [],
    store: StoreUrl = None,
    draw: DrawOption = None,
    against: Annotated[
        Path | None, typer.Option(metavar="RUN2", help="Compare with this run, not the nearest artifact.")
    ] = None,
    down: Annotated[
        bool,
        typer.Option("--down", help="What was made from it instead, down to scores; STAGE may be a leaf: keypoints."),
    ] = False,
) -> None:
    """What an artifact's address is made of, and the first field that differs from the nearest stored one."""
    from b23d.pipeline.inspection.explain import explain as explain_node
    from b23d.pipeline.run import Run

    loaded = Run.load(run, set, store)
    if down:
        _print_descent(loaded, shape, stage, draw)
        return
    told = explain_node(loaded, shape, stage, draw, Run.load(against, (), store) if against else None)
    of = f", draw {', '.join(map(str, told.draws))}" if told.draws else ""
    title = escape(f"{told.stage} of {told.shape}{of}: {told.state.upper()}, address {told.address[:16]}")
    table = Table("part", "value", title=title, title_justify="left")
    for part in told.parts:
        table.add_row(escape(part.name), escape(part.value))
    console.print(table)
    for cut in told.cuts:
        console.print(f"reused: {cut}", highlight=False, markup=False, soft_wrap=True)
    where = f"run {against}" if against else "the nearest stored artifact"
    if told.nearest is None:
        console.print(f"{told.stage} has made nothing of {told.shape} in this store yet", highlight=False, markup=False)
    elif told.nearest == told.address:
        console.print(f"the same as in {where}" if against else "stored under this very address", markup=False)
    else:
        console.print(f"differs from {where} ({told.nearest[:16]}) first in:", highlight=False, markup=False)
        if told.shots is not None:
            theirs, own = (", ".join(names) or "unknown" for names in told.shots)
            said = f"another draw: of these shots, {own}, it has none; compared with that of {theirs}"
            console.print(said, highlight=False, markup=False, soft_wrap=True)
        for difference in told.differences:
            console.print(f"  [bold]{escape(str(difference))}[/]", highlight=False)


def _print_descent(run: Run, shape: str, stage: str, draw: int | None) -> None:
    from b23d.pipeline.inspection.lineage import descent
    from b23d.pipeline.planning.nodes import State

    told = descent(run, shape, stage, draw)
    title = escape(f"made from {stage} of {shape}, run {run.name}")
    table = Table("stage", "artifacts", "stored", "shapes", title=title, title_justify="left")
    for name, nodes in told.below.items():
        stored = sum(node.state is State.CACHED for node in nodes)
        shapes = sorted({node.shape for node in nodes})
        more = f" and {len(shapes) - SHOWN} more" if len(shapes) > SHOWN else ""
        table.add_row(name, str(len(nodes)), str(stored), escape(", ".join(shapes[:SHOWN]) + more))
    console.print(table if told.below else f"nothing is made from {stage} of {shape}", highlight=False, markup=False)
    if told.as_shot:
        others = len(told.as_shot)
        count = f"{counted(others, 'other shape')} {'has' if others == 1 else 'have'} it among their shots"
        console.print(count, highlight=False, markup=False)
    for record in told.recorded:
        made = f"{record.began}, {record.run} {' '.join(record.overrides)}".rstrip()
        console.print(f"in record {record.id}: {made}, {record.ended}", highlight=False, markup=False, soft_wrap=True)
