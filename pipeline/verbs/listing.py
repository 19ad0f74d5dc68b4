"""`b23d list`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.verbs.options import Classes, Json, Limit, RunPath, Set, Shapes, StoreUrl
from b23d.pipeline.verbs.terminal import console

if TYPE_CHECKING:
    from b23d.pipeline.inspection.listing import ListedArtifact, ListedShape
    from b23d.pipeline.run import Run

STYLES = {"failed": "red", "blocked": "yellow", "waiting": "cyan", "done": "green"}


def list_(
    run: RunPath,
    stage: Annotated[str | None, typer.Option("--stage", metavar="STAGE", help="This stage's artifacts.")] = None,
    set: Set = [],
    store: StoreUrl = None,
    shape: Shapes = [],
    category: Classes = [],
    limit: Limit = None,
    as_json: Json = False,
) -> None:
    """A run's shapes, or a stage's artifacts, with their states and sizes. Nothing is executed."""
    from b23d.pipeline.inspection.listing import list_artifacts, list_shapes
    from b23d.pipeline.planning.selection import Selection
    from b23d.pipeline.run import Run

    loaded = Run.load(run, set, store)
    selection = Selection(tuple(shape), tuple(category), limit)
    if stage is None:
        shapes = list_shapes(loaded, selection)
        told, table = [row.as_json() for row in shapes], shapes_table(shapes)
    else:
        made = list_artifacts(loaded, stage, selection)
        told, table = [row.as_json() for row in made], artifacts_table(made, stage)
    if as_json:
        print(json.dumps(told, indent=1))
    else:
        console.print(table)


def stages_table(run: Run, shape: str) -> Table:
    """Every stage's artifacts of one shape. Raises SelectionError where there is no such shape."""
    from b23d.pipeline.inspection.listing import list_artifacts
    from b23d.pipeline.planning.selection import Selection

    selection = Selection(shapes=(shape,))
    found = [(stage, row) for stage in run.config.stages for row in list_artifacts(run, stage, selection)]
    table = Table("shape", "stage", "draw", "state", title_justify="left")
    table.add_column("MB", justify="right")
    table.add_column("what is wrong", overflow="fold")
    for stage, row in found:
        cells = [escape(row.shape), escape(stage), ", ".join(map(str, row.draws)) or "·", row.state]
        table.add_row(*cells, f"{row.bytes / 1e6:.2f}", escape(row.error))
    return table


def shapes_table(rows: list[ListedShape]) -> Table:
    table = Table("shape", "state", "annotated", "shot of draw", title_justify="left")
    table.add_column("MB", justify="right")
    table.add_column("what is wrong, or missing", overflow="fold")
    for row in rows:
        missing = [name for name, state in row.stages.items() if state == "waiting"]
        waiting = f"to run: {', '.join(missing)}" if missing else ""
        note = row.error or "; ".join(filter(None, (waiting, row.lack)))
        style = STYLES.get(row.state, "")
        draws = ", ".join(map(str, row.shot)) or "·"
        state = f"[{style}]{row.state}[/]" if style else row.state
        cells = [escape(row.shape), state, "yes" if row.annotated else "·", draws]
        table.add_row(*cells, f"{row.bytes / 1e6:.1f}", escape(note))
    return table


def artifacts_table(rows: list[ListedArtifact], stage: str) -> Table:
    table = Table("shape", "draw", "state", "address", title=escape(stage), title_justify="left")
    for column in ("MB", "s"):
        table.add_column(column, justify="right")
    table.add_column("what is wrong", overflow="fold")
    for row in rows:
        draws, style = ", ".join(map(str, row.draws)) or "·", STYLES.get(row.state, "")
        cells = [escape(row.shape), draws, f"[{style}]{row.state}[/]" if style else row.state, row.address[:12]]
        table.add_row(*cells, f"{row.bytes / 1e6:.2f}", f"{row.seconds:.2f}", escape(row.error))
    return table
