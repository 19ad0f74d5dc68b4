"""Executors: how ready tasks become outcomes. One in this process, one on dask.distributed.

The graph stays here: an executor sees ready tasks only, through a bounded window, deepest stage first, so that a data
set is finished shape by shape and neither memory nor the scheduler fills up with what nobody has asked for yet.
"""

from __future__ import annotations

import time
import uuid
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from queue import Empty, SimpleQueue
from typing import Any, Protocol

from b23d.pipeline.errors import ClusterError, ResourceError
from b23d.pipeline.runfile.plugins import Plugin
from b23d.pipeline.scheduling.cluster import Cluster
from b23d.pipeline.scheduling.tasks import Outcome, Task
from b23d.pipeline.scheduling.worker import run_batch, run_tasks
from b23d.pipeline.stage import Hints
from b23d.pipeline.storage.index import Failure
from b23d.schemas.runfile import Execution

PULSE = 1.0  # seconds without an outcome before the cluster is asked whether it is still there
NextBatch = Callable[[int], list[Task]]


class Executor(Protocol):
    address: str

    def run(self, next_batch: NextBatch) -> Iterator[Outcome]:
        """Yield outcomes as they come, asking `next_batch` for more whenever there is room. It is given the number of
        workers, and gives tasks in the order to do them in; none: nothing is ready now."""
        ...

    def lane(self, stage: str) -> object:
        """Tasks of one batch are of one lane: they need the same resources."""
        ...

    def close(self, at_once: bool = False) -> None:
        """Let go of the workers; `at_once`: of what they are doing, too."""
        ...


class InlineExecutor:
    """Everything in this process, one after the other: for tests and debugging."""

    address = "this process"

    def run(self, next_batch: NextBatch) -> Iterator[Outcome]:
        while batch := next_batch(1):
            yield from run_tasks(batch)

    def lane(self, stage: str) -> object:
        return None

    def close(self, at_once: bool = False) -> None:
        pass


class DaskExecutor:
    """dask.distributed: a cluster of processes made here (one thread each), or an existing one by its address.

    Raises ClusterError where the cluster does not come up, or has gone for longer than `options.timeout`, and
    ResourceError where no worker has what a stage needs.
    """

    def __init__(self, options: Execution, hints: dict[str, Hints], plugins: Sequence[Plugin] = ()) -> None:
        self._hints, self._options = hints, options
        self._cluster = Cluster(options)
        self._cluster.load(plugins)
        self.address = self._cluster.dashboard
        self._missing_since: float | None = None
        deadline = time.monotonic() + (options.timeout if options.scheduler else 0)
        while True:  # the workers of an existing cluster come one by one
            try:
                for stage in hints:
                    self._resources(stage)
                break
            except ResourceError:
                if time.monotonic() > deadline:
                    self.close()
                    raise
                time.sleep(PULSE / 4)
                self._cluster.missing([])

    def run(self, next_batch: NextBatch) -> Iterator[Outcome]:
        running: dict[str, list[Task]] = {}
        finished: SimpleQueue[Any] = SimpleQueue()
        again: list[list[Task]] = []  # lost with the connection to the scheduler
        suspects: deque[Task] = deque()  # were with a worker that died; each runs again alone, to know the guilty one
        lost: set[tuple[str, str]] = set()  # of suspects: what failed, and what would have needed it
        alone = False

        def submit(batch: list[Task]) -> None:
            key = f"{batch[0].stage}-{batch[0].address}-{uuid.uuid4().hex[:8]}"
            future = self._cluster.client.submit(
                run_batch, batch, key=key, pure=False, resources=self._resources(batch[0].stage) or None
            )
            running[key] = batch
            future.add_done_callback(finished.put)

        def room() -> bool:
            # two batches a thread: a worker never waits for this process
            free = not suspects and not alone and len(running) < 2 * self._cluster.slots
            return free and self._cluster.connected

        while True:
            while room() and (batch := again.pop() if again else next_batch(self._cluster.slots)):
                submit(batch)
            if not running and suspects and self._cluster.connected:
                if (task := suspects.popleft()).stored_inputs() & lost:
                    lost.add((task.stage, task.address))
                    continue
                submit([task])
                alone = True
            if not running and not suspects and not again:
                if not (batch := next_batch(max(1, self._cluster.slots))):
                    return
                again.append(batch)
            try:
                future = finished.get(timeout=PULSE)
            except Empty:
                self._check([task for batch in running.values() for task in batch])
                continue
            self._missing_since = None
            batch = running.pop(str(future.key))
            outcomes, error = _result(future)
            if error is not None:
                self._cluster.check_death(error)
                if alone:
                    outcomes = [_lost(batch[0], error)]
                else:
                    suspects.extend(batch)
            elif outcomes is None:
                again.append(batch)
            if alone and outcomes:
                lost.update((outcome.stage, outcome.address) for outcome in outcomes if outcome.failure)
            alone = False
            yield from outcomes or []
            future.release()

    def lane(self, stage: str) -> object:
        return tuple(self._resources(stage, check=False).items())

    def close(self, at_once: bool = False) -> None:
        self._cluster.close(at_once)

    def _check(self, running: list[Task]) -> None:
        """Raises ClusterError where for too long nothing can come any more."""
        missing = self._cluster.missing([self._resources(task.stage, check=False) for task in running])
        if missing is None:
            self._missing_since = None
            return
        self._missing_since = self._missing_since or time.monotonic()
        if time.monotonic() - self._missing_since > self._options.timeout:
            raise ClusterError(f"{missing}; what was finished is stored, run again to go on")

    def _resources(self, stage: str, check: bool = True) -> dict[str, float]:
        wanted = self._options.resources.get(stage)
        amount = wanted.gpu if wanted else 1.0 if self._hints[stage].gpu == "required" else 0.0
        offered = self._cluster.offered.get("gpu", 0.0)
        if check and amount > offered:
            raise ResourceError(
                f"stage {stage}: expected a worker with {amount:g} gpu, got workers with {offered:g}; "
                "start one with `dask worker --resources gpu=1`, or lower execution.resources"
            )
        if amount == 0 and offered and self._hints[stage].gpu == "useful":
            amount = 1.0
        return {"gpu": amount} if amount else {}


def _result(future: Any) -> tuple[list[Outcome] | None, BaseException | None]:
    """(outcomes, None), or (None, what happened instead); neither where it was lost on its way: to be run again."""
    from distributed import CancelledError

    try:
        return (
            (future.result(timeout=30), None) if future.status == "finished" else (None, future.exception(timeout=30))
        )
    except (CancelledError, TimeoutError):
        return None, None


def _lost(task: Task, error: BaseException) -> Outcome:
    text = (
        f"{task.shape}: expected the worker to finish {task.stage}, got its death ({type(error).__name__}: out of "
        "memory, or a crash in native code); raise execution.memory_gb, or run with --workers 0 to see"
    )
    failure = Failure(task.stage, task.shape, task.address, f"ChildProcessError: {text}", permanent=False)
    return Outcome(task.stage, task.address, task.shape, failure=failure)
