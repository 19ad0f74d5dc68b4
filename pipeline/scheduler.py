"""Executors: how ready tasks become outcomes. One in this process, one on dask.distributed.

The graph stays here: an executor sees ready tasks only, through a bounded window, deepest stage first, so that a data
set is finished shape by shape and neither memory nor the scheduler fills up with what nobody has asked for yet.
"""

from __future__ import annotations

import time
import uuid
from collections.abc import Callable, Iterator
from queue import Empty, SimpleQueue
from typing import Any, Protocol

from b23d.pipeline.cluster import Cluster
from b23d.pipeline.errors import ClusterError, ResourceError
from b23d.pipeline.index import Failure
from b23d.pipeline.stage import Hints
from b23d.pipeline.tasks import Outcome, Task, run_task
from b23d.schemas.runfile import Execution

PULSE = 1.0  # seconds without an outcome before the cluster is asked whether it is still there


class Executor(Protocol):
    address: str

    def run(self, next_task: Callable[[], Task | None]) -> Iterator[Outcome]:
        """Yield outcomes as they come, asking `next_task` for more whenever there is room; None: nothing is ready
        now."""
        ...

    def close(self, at_once: bool = False) -> None:
        """Let go of the workers; `at_once`: of what they are doing, too."""
        ...


class InlineExecutor:
    """Everything in this process, one after the other: for tests and debugging."""

    address = "this process"

    def run(self, next_task: Callable[[], Task | None]) -> Iterator[Outcome]:
        while (task := next_task()) is not None:
            yield run_task(task)

    def close(self, at_once: bool = False) -> None:
        pass


class DaskExecutor:
    """dask.distributed: a cluster of processes made here (one thread each), or an existing one by its address.

    Raises ClusterError where the cluster does not come up, or has gone for longer than `options.timeout`, and
    ResourceError where no worker has what a stage needs.
    """

    def __init__(self, options: Execution, hints: dict[str, Hints]) -> None:
        self._hints, self._options = hints, options
        self._cluster = Cluster(options)
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

    def run(self, next_task: Callable[[], Task | None]) -> Iterator[Outcome]:
        running: dict[str, Task] = {}
        finished: SimpleQueue[Any] = SimpleQueue()
        again: list[Task] = []  # lost with the connection to the scheduler
        suspects: list[Task] = []  # were on a worker that died; each runs again alone, so that the guilty one is known
        alone: Task | None = None

        def submit(task: Task) -> None:
            key = f"{task.stage}-{task.address}-{uuid.uuid4().hex[:8]}"
            future = self._cluster.client.submit(
                run_task, task, key=key, pure=False, resources=self._resources(task.stage) or None
            )
            running[key] = task
            future.add_done_callback(finished.put)

        def room() -> bool:
            # two tasks a thread: a worker never waits for this process
            free = not suspects and alone is None and len(running) < 2 * self._cluster.slots
            return free and self._cluster.connected

        while True:
            while room() and (task := again.pop() if again else next_task()) is not None:
                submit(task)
            if not running and suspects and self._cluster.connected:
                submit(alone := suspects.pop())
            if not running and not suspects and not again:
                if (task := next_task()) is None:
                    return
                again.append(task)
            try:
                future = finished.get(timeout=PULSE)
            except Empty:
                self._check(list(running.values()))
                continue
            self._missing_since = None
            task = running.pop(str(future.key))
            outcome, error = _result(future)
            if outcome is not None:
                yield outcome
            elif error is None:
                again.append(task)
            else:
                self._cluster.check_death(error)
                if task is alone:
                    yield _lost(task, error)
                else:
                    suspects.append(task)
            alone = None if task is alone else alone
            future.release()

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


def _result(future: Any) -> tuple[Outcome | None, BaseException | None]:
    """(outcome, None), or (None, what happened instead); neither where it was lost on its way: to be run again."""
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
