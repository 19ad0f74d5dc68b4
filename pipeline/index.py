"""The index beside a store: file digests, measured history, quarantine, what artifacts gave. A cache in sqlite, written
by the driver only.

Losing it loses no artifact: digests are computed again, projections start anew, quarantined shapes are tried again,
what artifacts gave is read from their heads. So it is never in the way: one that is damaged, or of another layout, is
made anew; one that is locked, read-only or on a full disk is done without, with one line on the log.
"""

from __future__ import annotations

import hashlib
import logging
import sqlite3
from collections.abc import Iterable, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

LAYOUT = 1
TABLES = {
    "file_digest": ["path text primary key", "size integer", "mtime integer", "digest text"],
    "history": [
        *("stage text", "address text", "shape text", "seconds real", "bytes integer", "peak_mb real"),
        "primary key (stage, address)",
    ],
    "run_file": ["path text primary key"],
    "quarantine": ["address text primary key", "stage text", "shape text", "error text", "permanent integer"],
    "gave": ["stage text", "address text primary key", "content text", "key text"],
}
BROKEN = {sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_ERROR, sqlite3.SQLITE_MISMATCH}
"""sqlite's codes for a file that is no index, or another program's."""

log = logging.getLogger("b23d")


@dataclass(frozen=True)
class Failure:
    """One (shape, stage) that failed, and how."""

    stage: str
    shape: str
    address: str
    error: str
    """`<type>: <message>`, as users read it."""
    permanent: bool
    """True: the data's fault; it would fail again. False: a lost worker, no memory, no space."""
    traceback: str = ""
    store: bool = False
    """The store failed, not the shape."""
    damaged: tuple[str, str] | None = None
    """(stage, address) of an input that is not, or no longer, what was written."""
    said: str = ""
    """What libraries printed and warned before."""


@dataclass(frozen=True)
class Cost:
    """What a stage has cost on average, by measured history."""

    seconds: float
    bytes: float
    peak_mb: float = 0.0
    """The highest peak of any of its tasks: memory must do for the worst."""


@dataclass(frozen=True)
class Given:
    """What an artifact gave, and of what: two digests (see `pipeline/address.py`)."""

    content: str
    key: str | None


class Index:
    def __init__(self, path: Path, write: bool = True) -> None:
        """`write=False`: nothing on the disk is changed; what is remembered is forgotten at the end."""
        self.path, self._write, self._said = path, write, False
        self._db = self._open()
        self._digests: dict[str, tuple[int, int, str]] | None = None
        self._new: dict[str, tuple[int, int, str]] = {}

    def close(self) -> None:
        self.save_digests()
        self._db.close()

    def file_digest(self, path: Path) -> str:
        """sha256 of a file's bytes; re-read only when its size or modification time has changed.

        Raises FileNotFoundError or another OSError where it cannot be read.
        """
        if self._digests is None:
            rows = self._read("select path, size, mtime, digest from file_digest")
            self._digests = {path: (size, mtime, digest) for path, size, mtime, digest in rows}
        key, stat = str(path), path.stat()
        known = self._digests.get(key)
        if known and known[0] == stat.st_size and known[1] == stat.st_mtime_ns:
            return known[2]
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
        self._digests[key] = self._new[key] = (stat.st_size, stat.st_mtime_ns, digest)
        return digest

    def save_digests(self) -> None:
        if self._new:
            rows = [(path, *known) for path, known in self._new.items()]
            self._change(("insert or replace into file_digest values (?, ?, ?, ?)", rows))
            self._new.clear()

    def record(
        self, stage: str, address: str, shape: str, seconds: float, size: int, peak_mb: float, given: Given
    ) -> None:
        """A task has succeeded: remember its cost and what it gave, forget its failure."""
        self._change(
            (
                "insert or replace into history values (?, ?, ?, ?, ?, ?)",
                [(stage, address, shape, seconds, size, peak_mb)],
            ),
            ("insert or replace into gave values (?, ?, ?, ?)", [(stage, address, given.content, given.key)]),
            ("delete from quarantine where address = ?", [(address,)]),
        )

    def quarantine(self, failure: Failure) -> None:
        row = (failure.address, failure.stage, failure.shape, failure.error, failure.permanent)
        self._change(("insert or replace into quarantine values (?, ?, ?, ?, ?)", [row]))

    def quarantined(self) -> dict[str, Failure]:
        """Failures by address."""
        rows = self._read("select address, stage, shape, error, permanent from quarantine")
        return {a: Failure(stage, shape, a, error, bool(permanent)) for a, stage, shape, error, permanent in rows}

    def costs(self) -> dict[str, Cost]:
        """Mean cost of each stage that has ever run in this store."""
        rows = self._read("select stage, avg(seconds), avg(bytes), max(peak_mb) from history group by stage")
        return {stage: Cost(seconds, size, peak) for stage, seconds, size, peak in rows}

    def history(self, stage: str) -> list[tuple[str, float, int, float]]:
        """(address, seconds, bytes, peak MB) of every recorded task of a stage."""
        return self._read("select address, seconds, bytes, peak_mb from history where stage = ?", (stage,))

    def made(self, stage: str, shape: str) -> list[str]:
        """Addresses of what a stage has ever made of a shape, latest last."""
        rows = self._read("select address from history where stage = ? and shape = ? order by rowid", (stage, shape))
        return [address for (address,) in rows]

    def shapes(self, stage: str) -> set[str]:
        """Shapes of which a stage has ever made something."""
        return {shape for (shape,) in self._read("select distinct shape from history where stage = ?", (stage,))}

    def given(self, stage: str) -> dict[str, Given]:
        """Address → what it gave, of every artifact of a stage that is known."""
        rows = self._read("select address, content, key from gave where stage = ?", (stage,))
        return {address: Given(content, key) for address, content, key in rows}

    def note_given(self, stage: str, found: dict[str, Given]) -> None:
        rows = [(stage, address, given.content, given.key) for address, given in found.items()]
        self._change(("insert or replace into gave values (?, ?, ?, ?)", rows))

    def run_files(self) -> list[Path]:
        """Run files that used this store before runs were noted in the store itself, and still exist."""
        rows = self._read("select path from run_file order by path")
        return [path for (text,) in rows if (path := Path(text)).exists()]

    def forget(self, addresses: Iterable[str]) -> None:
        rows = [(address,) for address in addresses]
        self._change(("delete from history where address = ?", rows), ("delete from gave where address = ?", rows))

    def _read(self, query: str, values: Sequence[Any] = ()) -> list[Any]:
        for _ in range(2):
            try:
                with closing(self._db.execute(query, values)) as rows:
                    return rows.fetchall()
            except sqlite3.Error as error:
                self._recover(error)
        return []

    def _change(self, *statements: tuple[str, list[Any]]) -> None:
        for _ in range(2):
            try:
                with self._db:
                    for statement, rows in statements:
                        self._db.executemany(statement, rows)
                return
            except sqlite3.Error as error:
                self._recover(error)

    def _recover(self, error: sqlite3.Error) -> None:
        """Go on with a new index where the old one is broken, else in memory, with what can still be read."""
        old = self._db
        if self._write and _code(error) in BROKEN:
            old.close()
            self._db = self._open()
            return
        self._say("done without it", error)
        self._db = _memory()
        with suppress(sqlite3.Error):
            _copy(old, self._db)

    def _open(self) -> sqlite3.Connection:
        try:
            return self._open_to_write() if self._write else self._open_to_read()
        except (sqlite3.Error, OSError) as error:
            self._say("done without it", error)
            return _memory()

    def _open_to_write(self) -> sqlite3.Connection:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        try:
            return self._prepared()
        except sqlite3.Error as error:
            if _code(error) not in BROKEN:
                raise
            self._say("made anew", error)
            for suffix in ("", "-wal", "-shm", "-journal"):
                self.path.with_name(self.path.name + suffix).unlink(missing_ok=True)
            return self._prepared()

    def _prepared(self) -> sqlite3.Connection:
        db = sqlite3.connect(self.path, timeout=10)
        try:
            db.execute("pragma journal_mode=delete")  # not WAL: a reader then needs to write nothing
            db.execute("pragma synchronous=off")
            _make(db)
            _check(db)
            return db
        except sqlite3.Error:
            db.close()
            raise

    def _open_to_read(self) -> sqlite3.Connection:
        if not self.path.exists():
            return _memory()
        for immutable in ("", "&immutable=1"):  # a read-only folder, or one with a killed run's journal
            db = sqlite3.connect(f"{self.path.absolute().as_uri()}?mode=ro{immutable}", uri=True, timeout=5)
            try:
                copy = _memory()
                _copy(db, copy)
                return copy
            except sqlite3.Error as error:
                last = error
            finally:
                db.close()
        raise last

    def _say(self, what: str, error: Exception) -> None:
        if not self._said:
            log.warning("index %s: expected a readable index, got: %s; %s, nothing is lost", self.path, error, what)
        self._said = True


def _make(db: sqlite3.Connection) -> None:
    layout = db.execute("pragma user_version").fetchone()[0]
    if layout > LAYOUT:
        raise sqlite3.DatabaseError("another program's layout")
    with db:
        for table, columns in TABLES.items():
            db.execute(f"create table if not exists {table} ({', '.join(columns)})")
        db.execute("create index if not exists history_shape on history (stage, shape)")
        db.execute("create index if not exists gave_stage on gave (stage)")
        if layout != LAYOUT:
            db.execute(f"pragma user_version={LAYOUT}")


def _check(db: sqlite3.Connection) -> None:
    """Raises sqlite3.Error where a table is not as declared."""
    for table in TABLES:
        db.execute(f"select {', '.join(_names(table))} from {table} limit 1").fetchall()


def _copy(db: sqlite3.Connection, into: sqlite3.Connection) -> None:
    """Every table that is there. Not sqlite's own backup: that waits for ever where the file is locked."""
    if db.execute("pragma user_version").fetchone()[0] > LAYOUT:
        raise sqlite3.DatabaseError("another program's layout")
    there = {name for (name,) in db.execute("select name from sqlite_master where type = 'table'").fetchall()}
    for table in TABLES.keys() & there:
        names = _names(table)
        places = ", ".join("?" * len(names))
        with into:
            into.executemany(
                f"insert into {table} values ({places})", db.execute(f"select {', '.join(names)} from {table}")
            )


def _names(table: str) -> list[str]:
    return [column.split()[0] for column in TABLES[table] if not column.startswith("primary")]


def _memory() -> sqlite3.Connection:
    db = sqlite3.connect(":memory:")
    _make(db)
    return db


def _code(error: sqlite3.Error) -> int:
    """sqlite's primary error code; what we raise ourselves counts as broken."""
    return getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF
