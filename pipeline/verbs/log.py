"""`b23d log`: what was run, when, with what, and what came of it."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.verbs.options import Json, Set, StoreUrl
from b23d.pipeline.verbs.terminal import console


def log(
    what: Annotated[
        str | None, typer.Argument(metavar="[RUN|ID]", help="A run file, or the id of one record.", show_default=False)
    ] = None,
    set: Set = [],
    store: StoreUrl = None,
    keep: Annotated[
        bool | None,
        typer.Option("--keep/--let-go", help="Have gc keep what it reached.", show_default=False),
    ] = None,
    as_json: Json = False,
) -> None:
    """Every execution of a store, or of one run file; with an ID, one of them in full."""
    from b23d.pipeline.planning.selection import Selection
    from b23d.pipeline.records import history
    from b23d.pipeline.verbs.recorded import tell
    from b23d.pipeline.verbs.stores import store_of

    path = Path(what) if what is not None and Path(what).is_file() else None
    opened = store_of(path, set, store)
    if what is not None and path is None:
        record = history.find(opened, what)
        if keep is not None:
            history.keep(opened, record, keep)
            record = history.find(opened, record.id)
        if as_json:
            print(json.dumps(asdict(record), indent=1))
        else:
            tell(record)
        return
    found = history.records(opened)
    if path is not None:
        found = [record for record in found if record.run_file == str(path.resolve())]
    if as_json:
        print(json.dumps([asdict(record) for record in found], indent=1))
        return
    table = Table(title=escape(f"history of {opened.url}"), title_justify="left")
    for column in ("id", "run", "overrides", "selected", "made", "s", "ended", "AUC", "kept"):
        table.add_column(column, overflow="fold", no_wrap=column == "id")
    for record in found:
        auc = _at(record.results, "scores", "mean", "auc", "mean")
        table.add_row(
            record.id,
            escape(record.run),
            escape(" ".join(record.overrides)),
            escape(Selection.recorded(record.selection).words),
            str(sum(record.made.values())),
            f"{record.seconds:.1f}",
            escape(record.ended),
            f"{auc:.3f}" if isinstance(auc, float) else "",
            "✓" if record.kept else "",
        )
    console.print(table if found else f"nothing was run yet in {opened.url}", highlight=False)


def _at(table: Any, *keys: str) -> Any:
    """What stands in tables within tables; None where there is none, as in records of other versions."""
    for key in keys:
        table = table.get(key) if isinstance(table, dict) else None
    return table
