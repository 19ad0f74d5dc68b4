"""Tasks: one artifact to make, as a small picklable value. Only addresses travel; a worker reads and writes the
store."""

from __future__ import annotations

import contextlib
import os
import platform
import resource
import subprocess
import time
import traceback
from collections import OrderedDict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from b23d.pipeline.dataset import Leaf
from b23d.pipeline.errors import naming
from b23d.pipeline.index import Failure
from b23d.pipeline.plan import LeafNode, Node, State
from b23d.pipeline.stage import Stage, load_stages
from b23d.pipeline.store import Store
from b23d.schemas.artifact import Artifact
from b23d.schemas.params import Params


@dataclass(frozen=True)
class Stored:
    """An input that is in the store."""

    stage: str
    address: str
    keep: bool = False
    """Keep it in the worker's memory: shots are read again for every target."""


@dataclass(frozen=True)
class Loaded:
    """An input that the data set gives."""

    leaf: Leaf
    address: str


@dataclass(frozen=True)
class Task:
    """Make one artifact. `inputs`: where each argument comes from; a nested Task is a transient stage, run inline."""

    stage: str
    address: str
    shape: str
    category: str
    draws: tuple[int, ...]
    shots: tuple[str, ...]
    params: Params
    inputs: dict[str, Stored | Loaded | Task | list[Stored | Loaded | Task]]
    store: str

    def input_addresses(self) -> dict[str, str | list[str]]:
        """Argument → address, as it entered this task's address."""
        return {
            name: [i.address for i in item] if isinstance(item, list) else item.address
            for name, item in self.inputs.items()
        }

    def nested(self) -> Iterator[Task]:
        """The transient tasks that run inside this one."""
        for item in self.inputs.values():
            for inner in item if isinstance(item, list) else [item]:
                if isinstance(inner, Task):
                    yield inner
                    yield from inner.nested()


@dataclass(frozen=True)
class Outcome:
    stage: str
    address: str
    shape: str
    seconds: float = 0.0
    """Of the stage's function and of what ran inline for it."""
    overhead: float = 0.0
    """Seconds of everything else a worker did: reading, checking, writing."""
    stored_bytes: int = 0
    peak_mb: float = 0.0
    failure: Failure | None = None


def make_task(node: Node, params: dict[str, Params], store: str) -> Task:
    """The task that makes a node; its transient ancestors are nested."""

    def source(item: Node | LeafNode, keep: bool) -> Stored | Loaded | Task:
        if isinstance(item, LeafNode):
            return Loaded(item.leaf, item.address)
        if item.state is State.TRANSIENT:
            return make_task(item, params, store)
        return Stored(item.stage, item.address, keep)

    inputs: dict[str, Stored | Loaded | Task | list[Stored | Loaded | Task]] = {}
    for argument, value in node.inputs.items():
        if isinstance(value, list):
            inputs[argument] = [source(item, keep=True) for item in value]
        elif value is not None:
            inputs[argument] = source(value, keep=False)
    draws = tuple(node.draws)
    return Task(
        node.stage, node.address, node.shape, node.category, draws, node.shots, params[node.stage], inputs, store
    )


def run_task(task: Task) -> Outcome:
    """Make and publish one artifact. Never raises: what goes wrong comes back as the outcome's failure."""
    started = time.perf_counter()
    store = _store(task.store)
    clock = _Clock()
    try:
        _reset_peak()
        artifact = _compute(task, store, clock, {})
        stored = store.write(task.stage, task.address, artifact, _provenance(task, clock.seconds))
        overhead = time.perf_counter() - started - clock.seconds
        return Outcome(task.stage, task.address, task.shape, clock.seconds, overhead, stored, peak_mb())
    except Exception as error:
        failure = failure_of(task, error)
        return Outcome(task.stage, task.address, task.shape, clock.seconds, peak_mb=peak_mb(), failure=failure)


def failure_of(task: Task, error: BaseException) -> Failure:
    permanent = not isinstance(error, MemoryError | OSError) or isinstance(error, FileNotFoundError)
    text = f"{type(error).__name__}: {naming(task.shape, str(error))}"
    return Failure(task.stage, task.shape, task.address, text, permanent, "".join(traceback.format_exception(error)))


class _Clock:
    """Adds up the seconds spent in stage functions."""

    seconds = 0.0


def _compute(task: Task, store: Store, clock: _Clock, made: dict[str, Artifact]) -> Artifact:
    """Run the stage's function on its inputs. `made` holds what ran inline for this task, so that nothing runs
    twice."""
    stage = _stages()[task.stage]

    def load(name: str, item: Stored | Loaded | Task) -> Artifact:
        if isinstance(item, Stored):
            schema = next(i.schema for i in stage.inputs if i.name == name)
            return _read(store, item, schema)
        if isinstance(item, Loaded):
            return item.leaf.read()
        if item.address not in made:
            made[item.address] = _compute(item, store, clock, made)
        return made[item.address]

    arguments: dict[str, Any] = {item.name: None for item in stage.inputs}
    for name, value in task.inputs.items():
        arguments[name] = [load(name, item) for item in value] if isinstance(value, list) else load(name, value)
    started = time.perf_counter()
    try:
        artifact = stage.function(**arguments, params=task.params)
    except Exception as error:
        error.add_note(f"stage {task.stage}, shape {task.shape}, address {task.address[:12]}")
        raise
    finally:
        clock.seconds += time.perf_counter() - started
    if not isinstance(artifact, stage.gives):
        raise TypeError(
            f"stage {task.stage}: expected to give {stage.gives.__name__}, got {type(artifact).__name__}; "
            "mend the stage"
        )
    return artifact


_KEPT: OrderedDict[tuple[str, str], Artifact] = OrderedDict()
KEEP = 16  # shots of a few classes and draws; each holds at most a feature and a distance matrix, about 10 MB


def _read(store: Store, item: Stored, schema: type[Artifact]) -> Artifact:
    key = (item.stage, item.address)
    if key in _KEPT:
        _KEPT.move_to_end(key)
        return _KEPT[key]
    artifact = store.read(item.stage, item.address, schema)
    if item.keep:
        _KEPT[key] = artifact
        while len(_KEPT) > KEEP:
            _KEPT.popitem(last=False)
    return artifact


@cache
def _store(url: str) -> Store:
    return Store(url)


@cache
def _stages() -> dict[str, Stage]:
    return load_stages()


def _provenance(task: Task, seconds: float) -> dict[str, Any]:
    stage = _stages()[task.stage]
    return {
        "stage": task.stage,
        "version": stage.version,
        "address": task.address,
        "shape": task.shape,
        "draws": list(task.draws),
        "shots": list(task.shots),
        "params": task.params.hashed(),
        "inputs": task.input_addresses(),
        "inline": {inner.address: _recipe(inner) for inner in task.nested()},
        "seconds": round(seconds, 4),
        "peak_mb": round(peak_mb(), 1),
        "created": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "device": _device(),
        "code": _commit(),
        "versions": _versions(),
    }


def _recipe(task: Task) -> dict[str, Any]:
    """What a transient task was made from: it has no provenance of its own."""
    version = _stages()[task.stage].version
    return {"stage": task.stage, "version": version, "params": task.params.hashed(), "inputs": task.input_addresses()}


@cache
def _versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for name in (
        "b23d",
        "numpy",
        "scipy",
        "torch",
        "transformers",
        "trimesh",
        "embreex",
        "pyrender",
        "potpourri3d",
        "zarr",
        "dask",
    ):
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


@cache
def _commit() -> str | None:
    """The code's git commit, where it runs from a checkout; `+` when the checkout has changes."""
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--abbrev=12", "--dirty=+"]
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip() or None
    except (OSError, subprocess.SubprocessError):
        return None


def _device() -> str:
    import sys

    torch = sys.modules.get("torch")  # a stage that used it has imported it
    if torch is not None and torch.cuda.is_available():
        return str(torch.cuda.get_device_name())
    return f"{platform.machine()}, {os.cpu_count()} cores"


def _reset_peak() -> None:
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")  # Linux: the high-water mark starts anew


def peak_mb() -> float:
    """This process's peak resident memory, of the running task where the system can tell (Linux), else since its
    start."""
    try:
        line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) / 1024
    except (OSError, StopIteration):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
