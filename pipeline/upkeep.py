"""Keeping a store: `verify` finds damage and marks it to run again, `gc` drops what no run reaches."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from b23d.pipeline.config import load_config
from b23d.pipeline.errors import B23dError
from b23d.pipeline.members import SUFFIX, members
from b23d.pipeline.plan import State
from b23d.pipeline.run import Run
from b23d.pipeline.store import Store


@dataclass(frozen=True)
class Damage:
    stage: str
    address: str
    shapes: tuple[str, ...]
    problems: tuple[str, ...]


@dataclass(frozen=True)
class Garbage:
    stage: str
    address: str
    stored_bytes: int


def verify(run: Run, watch: Callable[[int, int], None] = lambda done, total: None) -> Iterator[Damage]:
    """Check every digest of every artifact a run has, through zarr itself. Damaged ones are removed, so that they run
    again."""
    plan = run.plan()
    shapes: dict[tuple[str, str], set[str]] = {}
    for (stage, shape, _), node in plan.by_shape.items():
        shapes.setdefault((stage, node.address), set()).add(shape)
    cached = [node for node in plan.nodes.values() if node.state is State.CACHED]
    for done, node in enumerate(cached, 1):
        problems = run.store.damage(node.stage, node.address)
        if problems:
            run.store.delete(node.stage, node.address)
            run.index.forget([node.address])
            yield Damage(node.stage, node.address, tuple(sorted(shapes[node.stage, node.address])), tuple(problems))
        watch(done, len(cached))


def reached(run_files: Iterable[Path], store: Store, besides: Iterable[Path] = ()) -> set[tuple[str, str]]:
    """(stage, address) of everything that run files over this store reach: as they stand, members of their series
    included, and as executed, by the manifests in their folders: the last execution of the run itself, every one of its
    series.

    Raises what reading a run file raises: a run file that cannot be read must not lose its artifacts. A member whose
    weights cannot be had just now keeps what its manifest says. `besides`: run files that have never used the store;
    they count if they can.
    """
    found: set[tuple[str, str]] = set()
    for path in run_files:
        found |= _reached(path, store)
    for path in besides:
        with suppress(B23dError, OSError, ValueError):
            found |= _reached(path, store)
    return found


def _reached(path: Path, store: Store) -> set[tuple[str, str]]:
    run, found = Run(load_config(path)), set()
    if run.store.root == store.root:
        found |= set(run.plan().nodes)
        for member in members(run.config):
            with suppress(B23dError, OSError, ValueError):
                found |= set(Run.load(path, member.overrides).plan().nodes)
    for manifest in [
        run.folder / "manifest.json",
        *run.folder.with_name(run.folder.name + SUFFIX).glob("manifest-*.json"),
    ]:
        if manifest.exists():
            addresses = json.loads(manifest.read_text())["addresses"]
            found |= {(stage, address) for stage, made in addresses.items() for address in made}
    return found


def garbage(store: Store, keep: set[tuple[str, str]]) -> list[Garbage]:
    """What `keep` does not name, largest first."""
    lost = [
        Garbage(stage, address, _size(store, stage, address))
        for stage in store.stages()
        for address in store.addresses(stage)
        if (stage, address) not in keep
    ]
    return sorted(lost, key=lambda item: -item.stored_bytes)


def _size(store: Store, stage: str, address: str) -> int:
    return int(store.fs.du(store.path(stage, address)))
