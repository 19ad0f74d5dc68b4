"""The sqlite file of an index: opened, read and written so that it is never in the way. One that is damaged, or of
another layout, is made anew; one that is locked, read-only or on a full disk is done without, with one line on the
log."""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Sequence
from contextlib import closing, suppress
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


class Database:
    def __init__(self, path: Path, write: bool) -> None:
        """`write=False`: nothing on the disk is changed; what is remembered is forgotten at the end."""
        self.path, self._write, self._said = path, write, False
        self._db = self._open()

    def close(self) -> None:
        self._db.close()

    def read(self, query: str, values: Sequence[Any] = ()) -> list[Any]:
        for _ in range(2):
            try:
                with closing(self._db.execute(query, values)) as rows:
                    return rows.fetchall()
            except sqlite3.Error as error:
                self._recover(error)
        return []

    def change(self, *statements: tuple[str, list[Any]]) -> None:
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
