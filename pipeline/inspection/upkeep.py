"""Keeping a store: `verify` finds damage and marks it to run again, `gc` drops what no run reaches.

Reached is, by run files that have used the store and still exist: what each wants as it stands, members of its series
included; and what was last begun with it, with each set of overrides, whether that ended or was killed (see
`pipeline/storage/roots.py`). What a kept record reached (`b23d log ID --keep`) and what a running run wants stays in
any case. `as_written` leaves out what only overrides reach.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from b23d.pipeline.errors import B23dError, StoreError
from b23d.pipeline.planning.nodes import State
from b23d.pipeline.records.history import reached_by, records
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import load_config
from b23d.pipeline.runfile.members import SUFFIX, members
from b23d.pipeline.storage.index import Index
from b23d.pipeline.storage.roots import roots
from b23d.pipeline.store import Store


@dataclass(frozen=True)
class Damage:
    stage: str
    address: str
    shapes: tuple[str, ...]
    problems: tuple[str, ...]
    removed: bool = True
    """False: it could not be read, or not be removed, just now."""


@dataclass(frozen=True)
class Garbage:
    stage: str
    address: str
    stored_bytes: int


def verify(run: Run, watch: Callable[[int, int], None] = lambda done, total: None) -> Iterator[Damage]:
    """Check every digest of every artifact a run has, through zarr itself. Damaged ones are removed, so that they run
    again. Whatever is met, the rest is checked."""
    run.store.check_is_store()
    run.open_to_write()
    plan = run.plan()
    shapes: dict[tuple[str, str], set[str]] = {}
    for (stage, shape, _), node in plan.by_shape.items():
        shapes.setdefault((stage, node.address), set()).add(shape)
    cached = list({(n.stage, n.address): n for n in plan.nodes.values() if n.state is State.CACHED})
    for done, (stage, address) in enumerate(cached, 1):
        problems, removed = _check(run, stage, address)
        if problems:
            yield Damage(stage, address, tuple(sorted(shapes.get((stage, address), ()))), tuple(problems), removed)
        watch(done, len(cached))


def _check(run: Run, stage: str, address: str) -> tuple[list[str], bool]:
    """What is wrong with an artifact, and whether it has been removed for it."""
    try:
        problems = run.store.damage(stage, address)
    except StoreError as error:
        return [str(error)], False
    except Exception as error:  # whatever it is, it is this artifact's
        problems = [f"{type(error).__name__}: {error}"]
    if not problems:
        return [], False
    try:
        run.store.delete(stage, address)
        run.index.forget([address])
    except StoreError as error:
        return [*problems, str(error)], False
    return problems, True


def known_run_files(store: Store) -> list[Path]:
    """Run files that have used a store and still exist."""
    index = Index(Path(store.root) / "index.sqlite", write=False).run_files() if store.local else []
    noted = [root.run_file for root in roots(store) if root.run_file.exists()]
    return sorted({path.resolve() for path in [*index, *noted]})


def reached(
    run_files: Iterable[Path], store: Store, besides: Iterable[Path] = (), as_written: bool = False
) -> set[tuple[str, str]]:
    """(stage, address) of everything that run files over this store reach, and all that is leased.

    Raises what reading a run file raises: a run file that cannot be read must not lose its artifacts. A member whose
    weights cannot be had just now keeps what was last begun with it. `besides`: run files that have never used the
    store; they count if they can.
    """
    found: set[tuple[str, str]] = set()
    for path in run_files:
        found |= _reached(path, store, as_written)
    for path in besides:
        with suppress(B23dError, OSError, ValueError):
            found |= _reached(path, store, as_written)
    for root in roots(store):
        if root.leased or (root.run_file.exists() and not (as_written and root.overrides)):
            found |= root.reached()
    for record in records(store):
        if record.kept:
            found |= reached_by(store, record)
    return found


def _reached(path: Path, store: Store, as_written: bool) -> set[tuple[str, str]]:
    run, found = Run(load_config(path), _url(store)), set()
    uses = Store(run.config.file.store.root).root == store.root or any(root.run_file == path for root in roots(store))
    if uses and not run.config.dataset.handed_over:
        found |= run.plan().reached()
        for member in members(run.config):
            with suppress(B23dError, OSError, ValueError):
                found |= Run.load(path, member.overrides, _url(store)).plan().reached()
    for manifest in [
        run.folder / "manifest.json",
        *run.folder.with_name(run.folder.name + SUFFIX).glob("manifest-*.json"),
    ]:
        with suppress(FileNotFoundError):
            told = json.loads(manifest.read_text())
            if not (as_written and told["overrides"]):
                found |= {(stage, address) for stage, made in told["addresses"].items() for address in made}
    return found


def garbage(store: Store, keep: set[tuple[str, str]]) -> list[Garbage]:
    """What `keep` does not name, largest first. Only artifacts count: whatever else lies in the folder is not ours."""
    lost = [
        Garbage(stage, address, _size(store, stage, address))
        for stage in store.stages()
        for address in store.addresses(stage)
        if (stage, address) not in keep
    ]
    return sorted(lost, key=lambda item: -item.stored_bytes)


def shape_of(store: Store, item: Garbage) -> str:
    """The shape that an artifact was made of, as its head says; "?" where that cannot be read."""
    try:
        return str(store.head(item.stage, item.address).provenance.get("shape", "?"))
    except (B23dError, OSError):
        return "?"


def _url(store: Store) -> str:
    return str(store.root) if store.local else store.url


def _size(store: Store, stage: str, address: str) -> int:
    try:
        return int(store.fs.du(store.path(stage, address)))
    except OSError:
        return 0  # somebody else has just removed it
