"""What a worker does with the tasks it is given: read, compute, check, store; failures come back as outcomes."""

from __future__ import annotations

import json
import re
import time
import traceback
from collections import OrderedDict, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from b23d.pipeline.errors import ArtifactNotFoundError, CorruptArtifactError, StoreError, naming
from b23d.pipeline.scheduling.listening import Said, listening
from b23d.pipeline.scheduling.memory import peak_mb, reset_peak
from b23d.pipeline.scheduling.provenance import provenance
from b23d.pipeline.scheduling.tasks import Loaded, Outcome, Stored, Task
from b23d.pipeline.stage import load_stages_once
from b23d.pipeline.storage.index import Failure
from b23d.pipeline.storage.marker import MARKER
from b23d.pipeline.store import Store
from b23d.schemas.artifact import Artifact


def run_batch(tasks: Sequence[Task]) -> list[Outcome]:
    """In a worker process."""
    return list(run_tasks(tasks, apart=True))


def run_tasks(tasks: Sequence[Task], apart: bool = False) -> Iterator[Outcome]:
    """One after the other; what one has made is at hand for the next. What needs a failed one is left out. `apart`:
    this process is a worker."""
    wanted = [task.stored_inputs() for task in tasks]
    failed: set[tuple[str, str]] = set()
    _MADE.clear()
    for place, task in enumerate(tasks):
        key = (task.stage, task.address)
        if failed & wanted[place]:
            failed.add(key)
            continue
        later = set().union(*wanted[place + 1 :])
        outcome = run_task(task, keep=key in later, apart=apart)
        if outcome.failure is not None:
            failed.add(key)
        for done in _MADE.keys() - later:
            del _MADE[done]
        yield outcome
        if outcome.failure is not None and outcome.failure.store:
            return  # it would fail for each in turn


def run_task(task: Task, keep: bool = False, apart: bool = False) -> Outcome:
    """Make and publish one artifact. Never raises: what goes wrong comes back as the outcome's failure. `keep`: hold it
    in memory, too. What libraries say meanwhile is kept with what was made, and in the outcome."""
    started = time.perf_counter()
    store = _store(task.store)
    clock, said = _Clock(), Said()
    try:
        reset_peak()
        with listening(apart) as said:
            artifact = _compute(task, store, clock, {})
        spent = clock.seconds
        clock.parts["reading"] = time.perf_counter() - started - spent
        if store.local and not Path(store.root, MARKER).exists():  # taken away meanwhile: it is not begun anew
            raise StoreError(f"store: expected {store.url} to stay where it was, got nothing there; bring it back")
        made = provenance(task, spent, peak_mb(), clock.parts, said.text)
        stored, content = store.write(task.stage, task.address, artifact, made, task.key)
        if keep:
            _MADE[task.stage, task.address] = artifact
        overhead = time.perf_counter() - started - spent
        odd = tuple(_naming(task, line) for line in getattr(artifact, "warnings", ()))
        return Outcome(
            task.stage,
            task.address,
            task.shape,
            spent,
            overhead,
            stored,
            peak_mb(),
            content,
            task.key,
            said.text,
            warnings=odd,
        )
    except Exception as error:
        failure = replace(failure_of(task, error), said=said.text)
        named = task.stage, task.address, task.shape
        return Outcome(*named, clock.seconds, peak_mb=peak_mb(), failure=failure, said=said.text)


def _naming(task: Task, message: str) -> str:
    """The message with the names of the shots it tells of, and of whose it is: the shape's, or, where nothing but shots
    were seen, the draw's or the class's."""
    message = re.sub(r"\bshot (\d+)\b", lambda found: _shot(task, found), message)
    if task.shots and all(isinstance(item, list) for item in task.inputs.values()):
        if not task.draws:
            return naming(f"class {task.category}", message)
        return f"{task.category}, draw {', '.join(map(str, task.draws))}: {message}"
    return naming(task.shape, message)


def _shot(task: Task, found: re.Match[str]) -> str:
    place = int(found[1])
    return f"{found[0]} ({task.shots[place]})" if place < len(task.shots) else found[0]


def failure_of(task: Task, error: BaseException) -> Failure:
    permanent = not isinstance(error, MemoryError | OSError) or isinstance(error, FileNotFoundError)
    at_fault = str(error) if isinstance(error, StoreError) else _naming(task, str(error))
    text = f"{type(error).__name__}: {at_fault}"
    told, damaged = "".join(traceback.format_exception(error)), _damaged(error)
    return Failure(
        task.stage,
        task.shape,
        task.address,
        text,
        permanent and damaged is None,
        told,
        isinstance(error, StoreError),
        damaged,
    )


def _damaged(error: BaseException | None) -> tuple[str, str] | None:
    """The stored input that an error is about, if it is about one."""
    while error is not None:
        if isinstance(error, ArtifactNotFoundError | CorruptArtifactError) and error.artifact:
            return error.artifact
        error = error.__cause__ or error.__context__
    return None


class _Clock:
    """Adds up the seconds spent in stage functions: of the task's own stage, and of those that run inline for it."""

    def __init__(self) -> None:
        self.parts: dict[str, float] = defaultdict(float)

    @property
    def seconds(self) -> float:
        return sum(self.parts.values())


def _compute(task: Task, store: Store, clock: _Clock, made: dict[str, Artifact]) -> Artifact:
    """Run the stage's function on its inputs. `made` holds what ran inline for this task, so that nothing runs
    twice."""
    stage = load_stages_once()[task.stage]

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
        clock.parts[task.stage] += time.perf_counter() - started
    if not isinstance(artifact, stage.gives):
        raise TypeError(
            f"stage {task.stage}: expected to give {stage.gives.__name__}, got {type(artifact).__name__}; "
            "mend the stage"
        )
    return artifact


_KEPT: OrderedDict[tuple[str, str, str], Artifact] = OrderedDict()  # by store, stage, address
KEEP = 16  # shots of a few classes and draws; each holds at most a feature and a distance matrix, about 10 MB


_MADE: dict[tuple[str, str], Artifact] = {}  # by this batch, and wanted in it again


def as_stored(artifact: Artifact, schema: type[Artifact]) -> Artifact:
    """What reading it from the store would give, so that a batch changes no result: JSON values, arrays in C order."""
    arrays = {name: np.ascontiguousarray(value) for name, value in artifact.present_arrays().items()}
    values = json.loads(json.dumps(artifact.plain_fields()))
    return schema.lazy(values, set(arrays), arrays.__getitem__)


def _read(store: Store, item: Stored, schema: type[Artifact]) -> Artifact:
    if (item.stage, item.address) in _MADE:
        return as_stored(_MADE[item.stage, item.address], schema)
    key = (store.url, item.stage, item.address)
    if key in _KEPT:
        _KEPT.move_to_end(key)
        return _KEPT[key]
    artifact = store.read(item.stage, item.address, schema)
    if item.keep:
        _KEPT[key] = artifact.locked()
        while len(_KEPT) > KEEP:
            _KEPT.popitem(last=False)
    return artifact


@cache
def _store(url: str) -> Store:
    return Store(url)
