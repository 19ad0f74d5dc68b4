"""The index beside a store: file digests, measured history, quarantine, what artifacts gave. A cache in sqlite, written
by the driver only.

Losing it loses no artifact: digests are computed again, projections start anew, quarantined shapes are tried again,
what artifacts gave is read from their heads. So it is never in the way: one that is damaged, or of another layout, is
made anew; one that is locked, read-only or on a full disk is done without, with one line on the log.
"""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from b23d.pipeline.storage.database import Database

LATEST = 0.5  # seconds after which what was recorded is written


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
        self._database = Database(path, write)
        self._digests: dict[str, tuple[int, int, str]] | None = None
        self._new: dict[str, tuple[int, int, str]] = {}
        self._recorded: list[tuple[tuple[Any, ...], tuple[Any, ...]]] = []
        """Rows of history and gave that are not written yet."""
        self._written = time.monotonic()

    def close(self) -> None:
        self.save_digests()
        self._write_recorded()
        self._database.close()

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
        """A task has succeeded: remember its cost and what it gave, forget its failure. Written with others, at the
        latest `LATEST` seconds after it, or before anything is read here: a write of each costs more than the task."""
        self._recorded.append(
            ((stage, address, shape, seconds, size, peak_mb), (stage, address, given.content, given.key))
        )
        if time.monotonic() - self._written > LATEST:
            self._write_recorded()

    def _write_recorded(self) -> None:
        rows, self._recorded, self._written = self._recorded, [], time.monotonic()
        if rows:
            history, gave = (list(each) for each in zip(*rows, strict=True))
            self._change(
                ("insert or replace into history values (?, ?, ?, ?, ?, ?)", history),
                ("insert or replace into gave values (?, ?, ?, ?)", gave),
                ("delete from quarantine where address = ?", [(row[1],) for row in gave]),
            )

    def quarantine(self, failure: Failure) -> None:
        self._write_recorded()
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
        self._write_recorded()
        rows = [(address,) for address in addresses]
        self._change(("delete from history where address = ?", rows), ("delete from gave where address = ?", rows))

    def _read(self, query: str, values: Sequence[Any] = ()) -> list[Any]:
        self._write_recorded()
        return self._database.read(query, values)

    def _change(self, *statements: tuple[str, list[Any]]) -> None:
        self._database.change(*statements)
