"""`b23d diff`: two runs side by side: parameters, scores with their spread, shapes that got better and worse,
predictions that moved."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.console import Console

from b23d.pipeline.inspection.again import record_of, run_of
from b23d.pipeline.verbs.options import StoreUrl


def diff(
    run1: Annotated[str, typer.Argument(metavar="RUN1|ID1", help="A run file, or a record's id.")],
    run2: Annotated[str, typer.Argument(metavar="RUN2|ID2", help="Another.")],
    set1: Annotated[list[str], typer.Option("--set1", metavar="a.b=value", help="Overrides of RUN1.")] = [],
    set2: Annotated[list[str], typer.Option("--set2", metavar="a.b=value", help="Overrides of RUN2.")] = [],
    store: StoreUrl = None,
    most: Annotated[int, typer.Option(help="How many shapes to list each way.")] = 8,
) -> None:
    """Parameters that differ, scores side by side, shapes that got better and worse, predictions that moved."""
    from b23d.stages.workbench.results.differences import moved_table, parameter_table, score_table, shape_table
    from b23d.stages.workbench.results.headings import headings

    console = Console()
    console = console if console.is_terminal else Console(width=120)
    one, two = run_of(run1, set1, store), run_of(run2, set2, store)
    heads = headings(one, two, (record_of(run1, store), record_of(run2, store)))
    console.print(parameter_table(one, two, heads))
    console.print(score_table(one, two, heads))
    for table in (shape_table(one, two, heads, most), moved_table(one, two, heads, most)):
        console.print(table)
