"""`b23d params`."""

from __future__ import annotations

import json
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.errors import SelectionError
from b23d.pipeline.planning.hinting import hint
from b23d.pipeline.verbs.options import Json
from b23d.pipeline.verbs.terminal import console


def params(
    stage: Annotated[
        str | None,
        typer.Argument(metavar="[STAGE]", help="A stage, or shots, store, execution, dataset.", show_default=False),
    ] = None,
    as_json: Json = False,
) -> None:
    """Every field that a run file, or --set, can have: type, default, the method it belongs to, what it means."""
    from b23d.pipeline.runfile.fields import fields_of, tables

    found = tables()
    short = {name: name.removeprefix("stages.").partition(" ")[0] for name in found}
    chosen = {name: model for name, model in found.items() if stage in (None, name, short[name])}
    if not chosen:
        known = sorted(set(short.values()))
        near = hint(str(stage), known, f"it takes {', '.join(known)}")
        raise SelectionError(f"params: expected a stage or table of a run file, got {stage!r}; {near}")
    rows = {name: list(fields_of(model, name.partition(" ")[0])) for name, model in chosen.items()}
    if as_json:
        print(
            json.dumps({name: [row.as_json() for row in of] for name, of in rows.items()}, indent=1, ensure_ascii=False)
        )
        return
    for name, of in rows.items():
        table = Table("field", "takes", "default", "what it means", title=escape(f"[{name}]"), title_justify="left")
        table.columns[0].overflow = table.columns[1].overflow = table.columns[3].overflow = "fold"
        for row in of:
            prefix = name.partition(" ")[0]
            used = f"[dim]used by {escape(row.used)}.[/] " if row.used else ""
            apart = "" if row.address else "[dim](changes no result.)[/] "
            field = row.name.removeprefix(f"{prefix}.")
            table.add_row(escape(field), escape(row.takes), escape(row.default), f"{used}{apart}{escape(row.means)}")
        if of:
            console.print(table)
