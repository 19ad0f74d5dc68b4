"""A recorded run, ready to run again: the same run file with what it and its overrides said then."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from b23d.pipeline.errors import HistoryError
from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.records.history import Record, find
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import load_config
from b23d.pipeline.store import Store

STORE = "runs/.store"
"""Where records are looked for when no store and no run file is named."""


def run_of(named: str, overrides: Sequence[str] = (), store: str | None = None) -> Run:
    """A run by its run file, or by the id of a record. Raises what `Run.load` raises, and HistoryError."""
    if _is_file(named):
        return Run.load(named, overrides, store)
    opened = Store(store or STORE)
    return again(find(opened, named), opened, overrides)


def record_of(named: str, store: str | None = None) -> str:
    """The whole id of a record; "" for a run file. Raises HistoryError."""
    return "" if _is_file(named) else find(Store(store or STORE), named).id


def _is_file(named: str) -> bool:
    return Path(named).is_file() or named.endswith(".toml")


def selected_in(named: str, store: str | None = None) -> Selection:
    """What a record's run was asked for of it. Raises HistoryError."""
    return Selection.recorded(find(Store(store or STORE), named).selection)


def again(record: Record, store: Store, overrides: Sequence[str] = ()) -> Run:
    """The run as it was when it was recorded. What its file says otherwise today is set back by overrides.

    Raises HistoryError where the run file is gone, or says something new that no override can take back.
    """
    path = Path(record.run_file)
    if not path.exists():
        raise HistoryError(
            f"record {record.id}: expected its run file {path}, got nothing there; bring it back, or write one "
            "from what `b23d log` shows"
        )
    url = str(store.root) if store.local else store.url
    today = Run(load_config(path, record.overrides), url)
    back = [f"{name}={json.dumps(value)}" for name, value in _changed(_of(today), _recorded(record))]
    return Run(load_config(path, [*record.overrides, *back, *overrides]), url)


def _changed(now: Mapping[str, Any], then: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """(dotted field, value then) of every field that has another value now."""
    was = dict(_flat(then))
    return ((name, value) for name, value in was.items() if dict(_flat(now)).get(name, ...) != value)


def _of(run: Run) -> dict[str, Any]:
    config = run.config
    return {
        "stages": {name: params.hashed() for name, params in config.params.items()},
        "dataset": config.dataset.model_dump(mode="json"),
        "shots": config.file.shots.model_dump(mode="json"),
        "feeds": config.file.feeds,
        "outputs": config.file.outputs,
    }


def _recorded(record: Record) -> dict[str, Any]:
    return {"stages": record.params, "dataset": record.dataset, "shots": record.shots, **record.flow}


def _flat(table: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", value
