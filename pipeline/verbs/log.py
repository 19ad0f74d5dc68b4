"""`b23d log`: what was run, when, with what, and what came of it."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.verbs.options import Json, Set, StoreUrl
from b23d.pipeline.verbs.terminal import console

SHOWN = 20  # failures that are printed


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
    from b23d.pipeline.records import history
    from b23d.pipeline.verbs.stores import store_of

    path = Path(what) if what is not None and Path(what).is_file() else None
    opened = store_of(path, set, store)
    if what is not None and path is None:
        record = history.find(opened, what)
        if keep is not None:
            history.keep(opened, record, keep)
            record = history.find(opened, record.id)
        _one(record, as_json)
        return
    found = history.records(opened)
    if path is not None:
        found = [record for record in found if record.run_file == str(path.resolve())]
    if as_json:
        print(json.dumps([asdict(record) for record in found], indent=1))
        return
    table = Table(title=escape(f"history of {opened.url}"), title_justify="left")
    for column in ("id", "run", "overrides", "made", "s", "ended", "AUC", "kept"):
        table.add_column(column, overflow="fold", no_wrap=column == "id")
    for record in found:
        auc = record.results.get("scores", {}).get("mean", {}).get("auc", {}).get("mean")
        table.add_row(
            record.id,
            escape(record.run),
            escape(" ".join(record.overrides)),
            str(sum(record.made.values())),
            f"{record.seconds:.1f}",
            escape(record.ended),
            "" if auc is None else f"{auc:.3f}",
            "✓" if record.kept else "",
        )
    console.print(table if found else f"nothing was run yet in {opened.url}", highlight=False)


def _one(record: object, as_json: bool) -> None:
    from b23d.pipeline.records.history import Record

    assert isinstance(record, Record)
    if as_json:
        print(json.dumps(asdict(record), indent=1))
        return
    table = Table("what", "value", show_header=False, title=escape(f"record {record.id}"), title_justify="left")
    table.columns[1].overflow = "fold"
    told = asdict(record)
    for name in ("run", "run_file", "overrides", "selection", "began", "seconds", "ended", "kept"):
        table.add_row(name, escape(_text(told[name])))
    table.add_row("code", escape(_text(record.environment.get("code"))))
    table.add_row("machine", escape(_text(record.environment.get("device"))))
    table.add_row("versions", escape(_text(record.environment.get("versions"))))
    for stage, count in record.reached.items():
        table.add_row(f"artifacts of {stage}", f"{record.made.get(stage, 0)} made, {count} in all")
    for stage, params in record.params.items():
        table.add_row(f"stages.{stage}", escape(_text(params)))
    for name, result in record.results.items():
        table.add_row(name, escape(_text(result)[:2000]))
    console.print(table)
    for failure in record.failures[:SHOWN]:
        console.print(f"[red]✗[/] {escape(failure)}", highlight=False, soft_wrap=True)
    for task, said in record.said.items():
        console.print(f"before it failed, {task} said:\n{said}", highlight=False, markup=False, soft_wrap=True)
    if len(record.failures) > SHOWN:
        console.print(f"… and {len(record.failures) - SHOWN} more", highlight=False)


def _text(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value)
