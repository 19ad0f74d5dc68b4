"""`b23d explain`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.verbs.options import DrawOption, RunPath, Set, StoreUrl
from b23d.pipeline.verbs.terminal import console


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
) -> None:
    """What an artifact's address is made of, and the first field that differs from the nearest stored one."""
    from b23d.pipeline.explain import explain as explain_node
    from b23d.pipeline.run import Run

    loaded = Run.load(run, set, store)
    told = explain_node(loaded, shape, stage, draw, Run.load(against, (), store) if against else None)
    title = escape(f"{told.stage} of {told.shape}: {told.state.upper()}, address {told.address[:16]}")
    table = Table("part", "value", title=title, title_justify="left")
    for part in told.parts:
        table.add_row(escape(part.name), escape(part.value))
    console.print(table)
    where = f"run {against}" if against else "the nearest stored artifact"
    if told.nearest is None:
        console.print(f"{told.stage} has made nothing of {told.shape} in this store yet", highlight=False, markup=False)
    elif told.nearest == told.address:
        console.print(f"the same as in {where}" if against else "stored under this very address", markup=False)
    else:
        console.print(f"differs from {where} ({told.nearest[:16]}) first in:", highlight=False, markup=False)
        for difference in told.differences:
            console.print(f"  [bold]{escape(str(difference))}[/]", highlight=False)
