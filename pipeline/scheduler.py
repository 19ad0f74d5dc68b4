"""Executors: how ready tasks become outcomes. One in this process, one on dask.distributed (the only module with dask).

The graph stays here: an executor sees ready tasks only, through a bounded window, deepest stage first, so that a data
set is finished shape by shape and neither memory nor the scheduler fills up with what nobody has asked for yet.
"""

from __future__ import annotations

import contextlib
import uuid
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from typing import Any, Protocol

from b23d.pipeline.cluster import CONFIG, environ_kept, local_cluster
from b23d.pipeline.errors import ResourceError
from b23d.pipeline.index import Failure
from b23d.pipeline.stage import Hints
from b23d.pipeline.tasks import Outcome, Task, run_task
from b23d.schemas.runfile import Execution


class Executor(Protocol):
    address: str

    def run(self, next_task: Callable[[], Task | None]) -> Iterator[Outcome]:
        """Yield outcomes as they come, asking `next_task` for more whenever there is room; None: nothing is ready
        now."""
        ...

    def close(self) -> None: ...


class InlineExecutor:
    """Everything in this process, one after the other: for tests and debugging."""

    address = "this process"

    def run(self, next_task: Callable[[], Task | None]) -> Iterator[Outcome]:
        while (task := next_task()) is not None:
            yield run_task(task)

    def close(self) -> None:
        pass


class DaskExecutor:
    """dask.distributed: a cluster of processes made here (one thread each), or an existing one by its address."""

    def __init__(self, options: Execution, hints: dict[str, Hints]) -> None:
        import dask
        from distributed import Client

        self._restore = contextlib.ExitStack()  # the user's own settings come back when this is closed
        self._restore.enter_context(dask.config.set(CONFIG))
        self._restore.enter_context(environ_kept())
        self._hints, self._options = hints, options
        if options.scheduler:
            self._cluster = None
            self._client = Client(options.scheduler, set_as_default=False)
        else:
            self._cluster = local_cluster(options)
            self._client = Client(self._cluster, set_as_default=False)
        workers = self._client.scheduler_info(n_workers=-1)["workers"].values()
        self._slots = max(1, sum(worker["nthreads"] for worker in workers))
        self._offered = {name: amount for worker in workers for name, amount in worker.get("resources", {}).items()}
        self.address = str(self._client.dashboard_link)
        try:
            for stage in hints:
                self._resources(stage)
        except ResourceError:
            self.close()
            raise

    def run(self, next_task: Callable[[], Task | None]) -> Iterator[Outcome]:
        from distributed import as_completed

        running: dict[str, Task] = {}
        suspects: list[Task] = []  # were on a worker that died; each runs again alone, so that the guilty one is known
        alone: Task | None = None
        finished = as_completed([], loop=self._client.loop, raise_errors=False)

        def submit(task: Task) -> None:
            key = f"{task.stage}-{task.address}-{uuid.uuid4().hex[:8]}"
            future = self._client.submit(
                run_task, task, key=key, pure=False, resources=self._resources(task.stage) or None
            )
            running[str(future.key)] = task
            finished.add(future)

        while True:
            # two tasks a thread: a worker never waits for this process
            while (
                not suspects and alone is None and len(running) < 2 * self._slots and (task := next_task()) is not None
            ):
                submit(task)
            if not running and suspects:
                submit(alone := suspects.pop())
            if not running:
                return
            future = next(finished)
            task = running.pop(str(future.key))
            if future.status == "finished":
                yield future.result()
            elif task is alone:
                yield _lost(task, future)
            else:
                suspects.append(task)
            alone = None if task is alone else alone
            future.release()

    def close(self) -> None:
        self._client.close()
        if self._cluster is not None:
            self._cluster.close()
        self._restore.close()

    def _resources(self, stage: str) -> dict[str, float]:
        wanted = self._options.resources.get(stage)
        amount = wanted.gpu if wanted else 1.0 if self._hints[stage].gpu == "required" else 0.0
        offered = self._offered.get("gpu", 0.0)
        if amount > offered:
            raise ResourceError(
                f"stage {stage}: expected a worker with {amount:g} gpu, got workers with {offered:g}; "
                "start one with `dask worker --resources gpu=1`, or lower execution.resources"
            )
        if amount == 0 and offered and self._hints[stage].gpu == "useful":
            amount = 1.0
        return {"gpu": amount} if amount else {}


def _lost(task: Task, future: Any) -> Outcome:
    error = None if future.cancelled() else future.exception()
    reason = f"{type(error).__name__}" if error else CancelledError.__name__
    text = (
        f"{task.shape}: expected the worker to finish {task.stage}, got its death ({reason}: out of memory, "
        "or a crash in native code); raise execution.memory_gb, or run with --workers 0 to see"
    )
    failure = Failure(task.stage, task.shape, task.address, f"ChildProcessError: {text}", permanent=False)
    return Outcome(task.stage, task.address, task.shape, failure=failure)
