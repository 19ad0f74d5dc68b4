"""The index is a cache: damaged, locked, read-only, on a full disk or of another layout, nobody is stopped by it."""

from __future__ import annotations

import logging
import os
import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest

from b23d.pipeline.run import Run
from b23d.pipeline.storage.index import Failure, Given, Index
from tests.toy import make_toy


def corrupt(path: Path) -> None:
    path.write_bytes(b"this is no database, however long one looks at it" * 100)


def truncated(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:5000])


def flipped_inside(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[4096:] = bytes(byte ^ 0xFF for byte in data[4096:])
    path.write_bytes(data)


def empty(path: Path) -> None:
    path.write_bytes(b"")


def other_layout(path: Path) -> None:
    path.unlink()
    with sqlite3.connect(path) as db:
        db.execute("create table history (something text)")
        db.execute("create table quarantine (else_ text)")


def newer_layout(path: Path) -> None:
    with sqlite3.connect(path) as db:
        db.execute("pragma user_version=99")


def a_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


DAMAGES = [corrupt, truncated, flipped_inside, empty, other_layout, newer_layout, a_folder]


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_index_stops_nobody(
    tmp_path: Path, damage: Callable[[Path], None], caplog: pytest.LogCaptureFixture
) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    damage(tmp_path / "store" / "index.sqlite")
    with caplog.at_level(logging.WARNING, "b23d"):
        assert Run.load(path).plan().to_run() == []
        report = Run.load(path, ["stages.shift.by=4"]).execute(workers=0)
    assert report.ok and len(report.done) == 14, "what is stored is not made again"
    lines = [record.getMessage() for record in caplog.records]
    assert all("\n" not in line and "index" in line for line in lines) and len(lines) <= 2
    if damage is not a_folder:
        caplog.clear()
        assert Run.load(path).index.costs().keys() >= {"shift", "add"}, "it was made anew"
        assert not caplog.records


def test_a_locked_index_stops_nobody(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    connect = sqlite3.connect
    monkeypatch.setattr(sqlite3, "connect", lambda *a, **k: connect(*a, **{**k, "timeout": 0.01}))
    holder = connect(tmp_path / "store" / "index.sqlite", isolation_level=None)
    holder.execute("begin exclusive")
    try:
        assert Run.load(path).plan().to_run() == []
        assert Run.load(path, ["stages.shift.by=4"]).execute(workers=0).ok
    finally:
        holder.close()
    assert Run.load(path, ["stages.shift.by=4"]).plan().to_run() == []


class Failing:
    """A connection whose changes fail, as on a full or read-only disk."""

    def __init__(self, db: sqlite3.Connection, reason: str) -> None:
        self.db, self.reason = db, reason

    def __enter__(self) -> sqlite3.Connection:
        return self.db.__enter__()

    def __exit__(self, *told: object) -> None:
        self.db.__exit__(None, None, None)

    def executemany(self, *_: object) -> None:
        raise sqlite3.OperationalError(self.reason)

    def __getattr__(self, name: str) -> object:
        return getattr(self.db, name)


@pytest.mark.parametrize(
    "reason", ["database or disk is full", "attempt to write a readonly database", "disk I/O error"]
)
def test_what_cannot_be_written_is_kept_for_this_run(
    tmp_path: Path, reason: str, caplog: pytest.LogCaptureFixture
) -> None:
    index = Index(tmp_path / "index.sqlite")
    index.quarantine(Failure("square", "a", "00", "ValueError: a", True))
    db = Failing(index._database._db, reason)
    error = sqlite3.OperationalError(reason)
    error.sqlite_errorcode = sqlite3.SQLITE_FULL  # type: ignore[attr-defined]
    monkey = pytest.MonkeyPatch()
    monkey.setattr(Failing, "executemany", lambda *_: (_ for _ in ()).throw(error))
    index._database._db = db  # type: ignore[assignment]
    with caplog.at_level(logging.WARNING, "b23d"):
        index.record("square", "11", "b", 1.0, 10, 1.0, Given("c", "k"))
        index.record("square", "22", "b", 3.0, 10, 1.0, Given("c", "k"))
        index.costs()  # writes what was recorded first
    monkey.undo()
    assert index.costs()["square"].seconds == 2 and index.quarantined().keys() == {"00"}
    assert len(caplog.records) == 1


@pytest.mark.parametrize("owner", ["an ordinary user", "whoever runs this"])
def test_a_read_only_store_is_planned_and_read(tmp_path: Path, owner: str) -> None:
    if owner == "an ordinary user" and os.geteuid() == 0:
        pytest.skip("root writes everywhere")
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    store = tmp_path / "store"
    before = {file: file.stat().st_mtime_ns for file in [store, *store.rglob("*")]}
    for file in before:
        file.chmod(0o555 if file.is_dir() else 0o444)
    try:
        run = Run.load(path)
        assert run.plan().to_run() == [] and run.index.costs() and run.artifact("toy/s1", "shift")
    finally:
        for file in sorted(before):
            file.chmod(0o755 if file.is_dir() else 0o644)
    assert before == {file: file.stat().st_mtime_ns for file in [store, *store.rglob("*")]}


def test_looking_writes_nothing(tmp_path: Path) -> None:
    """Not even a store that is not there yet."""
    path = make_toy(tmp_path)
    before = set(tmp_path.rglob("*"))
    run = Run.load(path)
    run.plan()
    run.index.costs()
    assert set(tmp_path.rglob("*")) == before


def test_an_older_index_is_used(tmp_path: Path) -> None:
    """As it was before it had a layout number: write-ahead log, no table of what artifacts gave."""
    path = tmp_path / "index.sqlite"
    with sqlite3.connect(path) as db:
        db.execute("pragma journal_mode=wal")
        db.execute(
            "create table quarantine (address text primary key, stage text, shape text, error text, permanent integer)"
        )
        db.execute("insert into quarantine values ('00', 'square', 'a', 'ValueError: a', 1)")
    db.close()
    assert Index(path, write=False).quarantined().keys() == {"00"}
    index = Index(path)
    index.record("square", "11", "b", 1.0, 10, 1.0, Given("c", None))
    index.close()
    assert Index(path, write=False).given("square") == {"11": Given("c", None)}


def test_what_is_recorded_together_is_read_at_once_and_written_at_the_end(tmp_path: Path) -> None:
    index = Index(tmp_path / "index.sqlite")
    index.quarantine(Failure("square", "s0", "00", "ValueError: s0", True))
    for i in range(20):
        index.record("square", f"{i:02}", f"s{i}", float(i), 10, 1.0, Given(f"c{i}", f"k{i}"))
    assert len(index.history("square")) == len(index.given("square")) == 20 and index.quarantined() == {}
    index.record("square", "20", "s20", 0.0, 10, 1.0, Given("c", "k"))
    index.quarantine(Failure("square", "s20", "20", "ValueError: s20", True))
    assert "20" in index.quarantined(), "in the order they were told in"
    index.record("square", "21", "s21", 0.0, 10, 1.0, Given("c", "k"))
    index.close()
    assert len(Index(tmp_path / "index.sqlite", write=False).history("square")) == 22
