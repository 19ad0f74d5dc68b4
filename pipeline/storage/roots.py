"""Roots: what each run reaches, noted in the store before its first task. `gc` keeps that.

`.roots/<digest of run file and overrides>.json` is the latest plan of one run file with one set of overrides. It counts
as long as its run file exists, whether the run has ended well, badly or not yet. While a run lives it also holds a
lease, a file that it writes anew every ten seconds, with how far it is: what a leased root names is kept whatever else
is said. A lease belonged to a killed run, and counts no longer, when its process is gone (on this machine) or when it
has not been touched for a quarter of an hour.
"""

from __future__ import annotations

import json
import os
import socket
import threading
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from b23d.pipeline.address import canonical_json, sha256
from b23d.pipeline.errors import StoreError
from b23d.pipeline.storage.marker import names
from b23d.pipeline.storage.notes import put_note
from b23d.pipeline.store import Store

FOLDER = ".roots"
BEAT, STALE = 10.0, 900.0
"""Seconds between two touches of a lease, and after which one counts no longer."""


@dataclass(frozen=True)
class Root:
    """A run as it was last begun."""

    run_file: Path
    overrides: tuple[str, ...]
    addresses: dict[str, list[str]]
    """Stage → addresses."""
    leased: bool
    """The run is going on."""

    def reached(self) -> set[tuple[str, str]]:
        return {(stage, address) for stage, made in self.addresses.items() for address in made}


def note_root(
    store: Store, run_file: Path, overrides: Sequence[str], addresses: dict[str, list[str]], besides: bool = False
) -> str:
    """Note what a run reaches, in place of what it reached before, or `besides` that: what it will reuse is known for
    certain only at its end. Returns the root's name. Raises StoreError."""
    named = {"run": str(run_file.resolve()), "overrides": list(overrides)}
    name = sha256(canonical_json(named))[:32]
    with suppress(StoreError):  # none yet, or none that can be read
        before = _root(store, f"{name}.json", False).addresses
        if besides:
            stages = addresses.keys() | before.keys()
            addresses = {s: sorted({*addresses.get(s, []), *before.get(s, [])}) for s in sorted(stages)}
        if addresses == before:
            return name
    _put(store, f"{name}.json", {**named, "addresses": addresses})
    return name


def roots(store: Store) -> list[Root]:
    """Every noted root. Raises StoreError where one cannot be read: what it names must not be lost."""
    found = names(store.fs, f"{store.root}/{FOLDER}")
    leased = {name.split(".")[0] for name in found if name.endswith(".lease") and _fresh(store, name)}
    return [_root(store, name, name.split(".")[0] in leased) for name in found if _is_root(name)]


def stamp(store: Store) -> list[str]:
    """Changes when a run begins or ends."""
    return [name for name in names(store.fs, f"{store.root}/{FOLDER}") if _is_root(name) or name.endswith(".lease")]


@contextmanager
def lease(store: Store, name: str, progress: Callable[[], dict[str, Any]] = dict) -> Iterator[str]:
    """Hold a lease on a root while a run lives, and say in it how far the run is (JSON values). Gives the lease's name.

    Raises StoreError where it cannot be written at first.
    """
    file, ended = f"{name}.{uuid.uuid4().hex}.lease", threading.Event()
    holder = {"host": socket.gethostname(), "pid": os.getpid()}

    def told() -> dict[str, Any]:
        return {**holder, "time": time.time(), "progress": progress()}

    _put(store, file, told())

    def beat() -> None:
        while not ended.wait(BEAT):
            with suppress(StoreError):  # the run itself will find out
                _put(store, file, told())

    thread = threading.Thread(target=beat, daemon=True, name="b23d-lease")
    thread.start()
    try:
        yield file
    finally:
        ended.set()
        thread.join()
        with suppress(Exception):
            store.fs.rm_file(f"{store.root}/{FOLDER}/{file}")


def leases(store: Store) -> list[dict[str, Any]]:
    """What every running run says of itself: host, pid, time, progress; what cannot be read is left out."""
    found = []
    for name in names(store.fs, f"{store.root}/{FOLDER}"):
        if name.endswith(".lease") and _fresh(store, name):
            with suppress(OSError, ValueError, RecursionError):
                told = json.loads(store.fs.cat_file(f"{store.root}/{FOLDER}/{name}"))
                if isinstance(told, dict):
                    found.append(told)
    return found


def alive(store: Store, lease_name: str) -> bool:
    """Whether the run that holds a lease is still going on, as far as can be told."""
    return _fresh(store, lease_name)


def _is_root(name: str) -> bool:
    stem = name.removesuffix(".json")
    return name.endswith(".json") and len(stem) == 32 and set(stem) <= set("0123456789abcdef")


def _root(store: Store, name: str, leased: bool) -> Root:
    path = f"{store.root}/{FOLDER}/{name}"
    try:
        told = json.loads(store.fs.cat_file(path))
        addresses = {str(stage): [str(a) for a in made] for stage, made in told["addresses"].items()}
        return Root(Path(told["run"]), tuple(map(str, told["overrides"])), addresses, leased)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise StoreError(
            f"store {store.url}: expected to read what a run reaches from {FOLDER}/{name}, got {error!r}; "
            "remove that file if the run is no longer wanted"
        ) from error


def _fresh(store: Store, name: str) -> bool:
    try:
        told = json.loads(store.fs.cat_file(f"{store.root}/{FOLDER}/{name}"))
        if told["host"] == socket.gethostname() and not _runs(int(told["pid"])):
            return False
        return bool(time.time() - float(told["time"]) < STALE)
    except FileNotFoundError:
        return False
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return True  # being written just now, or damaged: then it rather counts


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True  # another user's
    return True


def _put(store: Store, name: str, value: dict[str, Any]) -> None:
    put_note(store, f"{FOLDER}/{name}", json.dumps(value).encode())
