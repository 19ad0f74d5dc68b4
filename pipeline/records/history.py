"""History: every execution leaves a record in the store, so that a table of last week can be traced to what made it.

`.records/<id>.json` says when, of which run file and overrides, with which code and packages, how it ended, and what
the tables said; `.records/<id>.addresses.gz` names every artifact that it reached. Nothing of a record enters an
address.
"""

from __future__ import annotations

import gzip
import json
import time
import uuid
from collections import Counter
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from pydantic import TypeAdapter

from b23d.pipeline.errors import HistoryError, StoreError
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.runfile.config import Config
from b23d.pipeline.scheduling.execution import Report
from b23d.pipeline.scheduling.provenance import environment
from b23d.pipeline.storage.marker import names
from b23d.pipeline.storage.notes import put_note
from b23d.pipeline.store import Store

FOLDER = ".records"
FAILURES = 1000
"""Most failures that a record tells."""


@dataclass(frozen=True)
class Record:
    """One execution of a run."""

    id: str
    """When it began (UTC, to the millisecond), and three random digits: sorts by time."""
    run: str
    run_file: str
    overrides: list[str]
    selection: dict[str, Any]
    """What of it was asked for; empty: everything."""
    params: dict[str, dict[str, Any]]
    """Stage → its fields that enter addresses, as they stood."""
    dataset: dict[str, Any]
    shots: dict[str, Any]
    flow: dict[str, Any]
    """`feeds` and `outputs`."""
    began: str
    environment: dict[str, Any] = field(default_factory=dict)
    """Code commit, package versions, machine."""
    seconds: float = 0.0
    ended: str = "running"
    """running, complete, incomplete (something failed), stopped, or the error that stopped it."""
    made: dict[str, int] = field(default_factory=dict)
    """Stage → artifacts it made."""
    reached: dict[str, int] = field(default_factory=dict)
    """Stage → artifacts it has in all."""
    failures: list[str] = field(default_factory=list)
    said: dict[str, str] = field(default_factory=dict)
    """`<stage> of <shape>` → what libraries printed and warned before it failed."""
    blocked: int = 0
    results: dict[str, Any] = field(default_factory=dict)
    """Tables printed after the run, by name: `scores`, `parts`."""
    kept: bool = False
    """`gc` keeps all that it reached."""


RECORD = TypeAdapter(Record)


def begin(store: Store, config: Config, selection: Selection) -> Record:
    """A record of an execution that begins now, written to the store. Raises StoreError."""
    instant = time.time()
    now, milliseconds = time.gmtime(instant), int(instant % 1 * 1000)
    record = Record(
        id=f"{time.strftime('%y%m%d-%H%M%S', now)}-{milliseconds:03d}{uuid.uuid4().hex[:3]}",
        run=config.file.name,
        run_file=str(config.path.resolve()),
        overrides=list(config.overrides),
        selection={key: value for key, value in asdict(selection).items() if value},
        params={name: params.hashed() for name, params in config.params.items()},
        dataset=config.dataset.model_dump(mode="json"),
        shots=config.file.shots.model_dump(mode="json"),
        flow={"feeds": config.file.feeds, "outputs": config.file.outputs},
        began=time.strftime("%Y-%m-%d %H:%M:%S", now),
        environment=environment(),
    )
    _put(store, record)
    return record


def finish(store: Store, record: Record, plan: Plan, report: Report) -> Record:
    """The record of an execution that came to its end. Raises StoreError."""
    addresses = sorted(plan.reached())
    lines = [f"{stage} {address}" for stage, address in addresses]
    put_note(store, f"{FOLDER}/{record.id}.addresses.gz", gzip.compress("\n".join(lines).encode(), 1, mtime=0))
    ended = replace(
        record,
        seconds=round(report.seconds, 2),
        ended="complete" if report.ok else "incomplete",
        made=dict(Counter(outcome.stage for outcome in report.done)),
        reached=dict(Counter(stage for stage, _ in addresses)),
        failures=[f"{failure.stage}: {failure.error}" for failure in report.failures[:FAILURES]],
        said={f"{failure.stage} of {failure.shape}": failure.said for failure in report.failures if failure.said},
        blocked=report.blocked,
    )
    _put(store, ended)
    return ended


def stopped(store: Store, record: Record, seconds: float, why: str) -> None:
    """Note that an execution did not come to its end, as far as the store still takes notes."""
    try:
        _put(store, replace(record, seconds=round(seconds, 2), ended=why))
    except StoreError:
        return


def attach(store: Store, record_id: str, name: str, table: Any) -> None:
    """Put a table printed after a run (JSON values) into its record. Raises HistoryError, StoreError."""
    record = find(store, record_id)
    _put(store, replace(record, results={**record.results, name: table}))


def keep(store: Store, record: Record, kept: bool) -> None:
    """Have `gc` keep what a record reached, or no longer. Raises StoreError."""
    _put(store, replace(record, kept=kept))


def records(store: Store) -> list[Record]:
    """Every record, oldest first; one that cannot be read is left out: history is told, never relied upon."""
    files = sorted(name for name in names(store.fs, f"{store.root}/{FOLDER}") if name.endswith(".json"))
    return [record for name in files if (record := _read(store, name)) is not None]


def find(store: Store, prefix: str) -> Record:
    """The record whose id begins with `prefix`. Raises HistoryError where there is none, or more than one."""
    found = [record for record in records(store) if record.id.startswith(prefix)]
    exact = [record for record in found if record.id == prefix]
    if len(exact or found) == 1:
        return (exact or found)[0]
    got = f"{len(found)} of them" if found else "none"
    raise HistoryError(
        f"history of {store.url}: expected one record whose id begins with {prefix!r}, got {got}; see `b23d log`"
    )


def reached_by(store: Store, record: Record) -> set[tuple[str, str]]:
    """(stage, address) of every artifact that an execution reached; empty where it never came to its end."""
    try:
        data = gzip.decompress(store.fs.cat_file(f"{store.root}/{FOLDER}/{record.id}.addresses.gz"))
    except (OSError, EOFError):
        return set()
    pairs = (line.split(" ") for line in data.decode().splitlines())
    return {(stage, address) for stage, address in pairs}


def _put(store: Store, record: Record) -> None:
    put_note(store, f"{FOLDER}/{record.id}.json", json.dumps(asdict(record), indent=1).encode())


def _read(store: Store, name: str) -> Record | None:
    try:
        told = json.loads(store.fs.cat_file(f"{store.root}/{FOLDER}/{name}"))
        return RECORD.validate_python(told)  # fields of a later version are passed over
    except (OSError, ValueError, TypeError, RecursionError):
        return None
