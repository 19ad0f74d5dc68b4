"""One record, as `b23d log ID` tells it: what was asked for, what came of it, with what. `--json` has every digit."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping
from importlib.metadata import entry_points
from typing import Any

from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.records.history import Record
from b23d.pipeline.verbs.terminal import console
from b23d.schemas.params import flat
from b23d.schemas.wording import counted

SHOWN = 20  # failures that are printed


def tell(record: Record) -> None:
    """Print a record: a table of what was run, then the tables of its results, then what failed."""
    table = Table("what", "value", show_header=False, title=escape(f"record {record.id}"), title_justify="left")
    table.columns[1].overflow = "fold"
    for name, value in _lines(record):
        table.add_row(name, escape(value))
    console.print(table)
    for name, result in record.results.items():
        console.print(_table(name, result))
    for failure in record.failures[:SHOWN]:
        console.print(f"[red]✗[/] {escape(failure)}", highlight=False, soft_wrap=True)
    for task, said in record.said.items():
        console.print(f"before it failed, {task} said:\n{said}", highlight=False, markup=False, soft_wrap=True)
    if len(record.failures) > SHOWN:
        console.print(f"… and {len(record.failures) - SHOWN} more", highlight=False)


def _lines(record: Record) -> Iterator[tuple[str, str]]:
    """What was asked for, what came of it, with what."""
    yield "run", record.run
    yield "run file", record.run_file
    yield "overrides", " ".join(record.overrides) or "none"
    yield "selected", Selection.recorded(record.selection).words or "everything"
    yield "began", f"{record.began} UTC"
    yield "took", f"{record.seconds:.1f} s"
    yield "ended", record.ended + (f", {counted(record.blocked, 'task')} blocked" if record.blocked else "")
    yield "kept", "yes: gc keeps what it reached" if record.kept else "no"
    yield "code", _value(record.environment.get("code"))
    yield "machine", _value(record.environment.get("device"))
    yield "versions", _listed(record.environment.get("versions") or {}, " ")
    for stage, count in record.reached.items():
        yield f"artifacts of {stage}", f"{record.made.get(stage, 0)} made, {count} in all"
    for name, fields in {"dataset": record.dataset, "shots": record.shots, **record.flow}.items():
        yield name, _listed(flat(fields)) if isinstance(fields, dict) else _value(fields)
    for stage, params in record.params.items():
        yield f"stages.{stage}", _listed(flat(params))


def _table(name: str, result: Any) -> RenderableType:
    """The table of a result, drawn by what made it (entry points `b23d.recorded`); else its values, a line each."""
    for drawn in entry_points(group="b23d.recorded", name=name):
        try:
            found: RenderableType = drawn.load()(result)
            return found
        except (ValueError, KeyError, TypeError):  # of an older version: shown plainly
            break
    plain = Table(name, "value", title_justify="left")
    for key, value in flat(result if isinstance(result, dict) else {"": result}).items():
        plain.add_row(escape(key), escape(_value(value)))
    return plain


def _listed(fields: Mapping[str, Any], between: str = "=") -> str:
    return ", ".join(f"{key}{between}{_value(value)}" for key, value in fields.items()) or "none"


def _value(value: Any) -> str:
    """A value for people: numbers with four digits, lists without brackets around."""
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, Iterable) and not isinstance(value, str | Mapping):
        return f"[{', '.join(map(_value, value))}]"
    return value if isinstance(value, str) else "none" if value is None else json.dumps(value)
