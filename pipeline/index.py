"""The index beside a store: file digests, measured history, quarantine. A cache in sqlite, written by the driver only.

Losing it loses no artifact: digests are computed again, projections start anew, quarantined shapes are tried again.
"""

from __future__ import annotations

import hashlib
import sqlite3
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

TABLES = """
create table if not exists file_digest (path text primary key, size integer, mtime integer, digest text);
create table if not exists history (
    stage text, address text, shape text, seconds real, bytes integer, peak_mb real, primary key (stage, address)
);
create index if not exists history_shape on history (stage, shape);
create table if not exists run_file (path text primary key);
create table if not exists quarantine (address text primary key, stage text, shape text, error text, permanent integer);
"""


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


@dataclass(frozen=True)
class Cost:
    """What a stage has cost on average, by measured history."""

    seconds: float
    bytes: float


class Index:
    def __init__(self, path: Path) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self.path = path
        self._db = sqlite3.connect(path, timeout=30)
        self._db.execute("pragma journal_mode=wal")
        self._db.execute("pragma synchronous=off")
        self._db.executescript(TABLES)
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
            with closing(self._db.execute("select path, size, mtime, digest from file_digest")) as rows:
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
        with self._db:
            rows = [(path, *known) for path, known in self._new.items()]
            self._db.executemany("insert or replace into file_digest values (?, ?, ?, ?)", rows)
        self._new.clear()

    def record(self, stage: str, address: str, shape: str, seconds: float, size: int, peak_mb: float) -> None:
        """A task has succeeded: remember its cost, forget its failure."""
        with self._db:
            row = (stage, address, shape, seconds, size, peak_mb)
            self._db.execute("insert or replace into history values (?, ?, ?, ?, ?, ?)", row)
            self._db.execute("delete from quarantine where address = ?", (address,))

    def quarantine(self, failure: Failure) -> None:
        row = (failure.address, failure.stage, failure.shape, failure.error, failure.permanent)
        with self._db:
            self._db.execute("insert or replace into quarantine values (?, ?, ?, ?, ?)", row)

    def quarantined(self) -> dict[str, Failure]:
        """Failures by address."""
        with closing(self._db.execute("select address, stage, shape, error, permanent from quarantine")) as rows:
            return {a: Failure(stage, shape, a, error, bool(permanent)) for a, stage, shape, error, permanent in rows}

    def costs(self) -> dict[str, Cost]:
        """Mean cost of each stage that has ever run in this store."""
        with closing(self._db.execute("select stage, avg(seconds), avg(bytes) from history group by stage")) as rows:
            return {stage: Cost(seconds, size) for stage, seconds, size in rows}

    def history(self, stage: str) -> list[tuple[str, float, int, float]]:
        """(address, seconds, bytes, peak MB) of every recorded task of a stage."""
        query = "select address, seconds, bytes, peak_mb from history where stage = ?"
        with closing(self._db.execute(query, (stage,))) as rows:
            return list(rows)

    def made(self, stage: str, shape: str) -> list[str]:
        """Addresses of what a stage has ever made of a shape, latest last."""
        query = "select address from history where stage = ? and shape = ? order by rowid"
        with closing(self._db.execute(query, (stage, shape))) as rows:
            return [address for (address,) in rows]

    def note_run_file(self, path: Path) -> None:
        """A run file that has used this store: `gc` keeps what it reaches."""
        with self._db:
            self._db.execute("insert or ignore into run_file values (?)", (str(path.resolve()),))

    def run_files(self) -> list[Path]:
        """Run files that have used this store and still exist."""
        with closing(self._db.execute("select path from run_file order by path")) as rows:
            return [path for (text,) in rows if (path := Path(text)).exists()]

    def forget(self, addresses: Iterable[str]) -> None:
        with self._db:
            self._db.executemany("delete from history where address = ?", [(a,) for a in addresses])
