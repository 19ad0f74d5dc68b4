"""Executors: how ready tasks become outcomes. One in this process, one on dask.distributed (the only module with dask).

The graph stays here: an executor sees ready tasks only, through a bounded window, deepest stage first, so that a data
set is finished shape by shape and neither memory nor the scheduler fills up with what nobody has asked for yet.
"""

from __future__ import annotations

import heapq
import os
import uuid
from collections import defaultdict
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from pathlib import Path
from typing import Any, Protocol

from b23d.pipeline.errors import ResourceError
from b23d.pipeline.index import Failure
from b23d.pipeline.plan import LeafNode, Node, Plan, State
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


class Frontier:
    """Which nodes are ready: all they need is stored. Deepest stage first, then in order."""

    def __init__(self, plan: Plan) -> None:
        depth = {stage: index for index, stage in enumerate(plan.stages)}
        self._key = {(n.stage, n.address): (-depth[n.stage], order) for order, n in enumerate(plan.nodes.values())}
        self._waiting: dict[tuple[str, str], int] = {}
        self._below: dict[tuple[str, str], list[Node]] = defaultdict(list)
        self._ready: list[tuple[tuple[int, int], Node]] = []
        self._blocked: set[tuple[str, str]] = set()
        for node in plan.to_run():
            above = set(_needed(node))
            self._waiting[node.stage, node.address] = len(above)
            for key in above:
                self._below[key].append(node)
            if not above:
                self._push(node)

    def pop(self) -> Node | None:
        return heapq.heappop(self._ready)[1] if self._ready else None

    def done(self, stage: str, address: str) -> None:
        for node in self._below.pop((stage, address), []):
            key = (node.stage, node.address)
            self._waiting[key] -= 1
            if self._waiting[key] == 0 and key not in self._blocked:
                self._push(node)

    def failed(self, stage: str, address: str) -> list[Node]:
        """Everything below, which is now blocked."""
        lost: list[Node] = []
        stack = self._below.pop((stage, address), [])
        while stack:
            node = stack.pop()
            key = (node.stage, node.address)
            if key not in self._blocked:
                self._blocked.add(key)
                lost.append(node)
                stack += self._below.pop(key, [])
        return lost

    def _push(self, node: Node) -> None:
        heapq.heappush(self._ready, (self._key[node.stage, node.address], node))


def _needed(node: Node) -> Iterator[tuple[str, str]]:
    """Stored artifacts that must exist before this node can run, looking through transient stages."""
    for above in node.upstream():
        if isinstance(above, LeafNode) or above.state is State.CACHED:
            continue
        if above.state is State.TRANSIENT:
            yield from _needed(above)
        else:
            yield above.stage, above.address


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

        # A worker that dies is reported at once, with its task; heartbeats must not mistake a busy CPU for a death.
        dask.config.set(
            {
                "distributed.scheduler.allowed-failures": 0,
                "distributed.comm.timeouts.connect": "60s",
                "distributed.scheduler.worker-ttl": "15 minutes",
                "distributed.worker.daemon": True,
                "distributed.admin.tick.limit": "1h",
            }
        )
        self._hints, self._options = hints, options
        if options.scheduler:
            self._cluster = None
            self._client = Client(options.scheduler, set_as_default=False)
        else:
            self._cluster = _local_cluster(options)
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


def _local_cluster(options: Execution) -> Any:
    """One process a core, and one more a GPU that alone offers `gpu`; `workers` bounds the former."""
    from distributed import Nanny, Scheduler, SpecCluster

    # One thread a process: BLAS and torch would otherwise fight for the cores that other workers use.
    env = dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    common = {"nthreads": 1, "memory_limit": int(options.memory_gb * 2**30), "silence_logs": 50}
    count, gpus = options.workers or os.cpu_count() or 1, _gpus()
    hidden = {**env, "CUDA_VISIBLE_DEVICES": ""} if gpus else env
    workers = {f"cpu-{i}": {"cls": Nanny, "options": {**common, "env": hidden}} for i in range(count)}
    for gpu in gpus:
        workers[f"gpu-{gpu}"] = {
            "cls": Nanny,
            "options": {**common, "env": {**env, "CUDA_VISIBLE_DEVICES": gpu}, "resources": {"gpu": 1}},
        }
    scheduler = {"cls": Scheduler, "options": {"host": "127.0.0.1", "dashboard_address": "127.0.0.1:0"}}
    return SpecCluster(workers=workers, scheduler=scheduler, silence_logs=50, name="b23d")


def _gpus() -> list[str]:
    """Ids of the GPUs this process may use, without loading CUDA."""
    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    if visible is not None:
        return [gpu for gpu in visible.split(",") if gpu]
    return [str(i) for i, _ in enumerate(Path("/proc/driver/nvidia/gpus").glob("*"))]


def _lost(task: Task, future: Any) -> Outcome:
    error = None if future.cancelled() else future.exception()
    reason = f"{type(error).__name__}" if error else CancelledError.__name__
    text = (
        f"{task.shape}: expected the worker to finish {task.stage}, got its death ({reason}: out of memory, "
        "or a crash in native code); "
        "raise execution.memory_gb, or run with --workers 0 to see"
    )
    failure = Failure(task.stage, task.shape, task.address, f"ChildProcessError: {text}", permanent=False)
    return Outcome(task.stage, task.address, task.shape, failure=failure)
