"""The dask cluster that runs a run's tasks: one made here, every socket of it on loopback, or an existing one."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import product
from multiprocessing import resource_tracker
from pathlib import Path
from typing import Any

from b23d.pipeline.errors import ClusterError, RunFileError
from b23d.pipeline.runfile.plugins import Plugin
from b23d.schemas.runfile import Execution
from b23d.schemas.wording import counted

LOOPBACK = "127.0.0.1"  # whoever reaches a worker's or scheduler's socket runs code in it
STARTS = 2  # a worker that dies at once is often one for which there was no memory just then
GIB = str(2**30)
ENVIRON = {
    # One thread a process: BLAS and torch would otherwise fight for the cores that other workers use.
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    # Freed arrays stay in the process: dask's own 64 KiB for trimming has them faulted in again, for most of a run.
    "MALLOC_MMAP_THRESHOLD_": GIB,
    "MALLOC_TRIM_THRESHOLD_": GIB,
    "DASK_LOGGING__DISTRIBUTED": "critical",  # a message that a stop cuts short is no traceback to show
}
CONFIG = {
    # A worker that dies is reported at once, with its task; heartbeats must not mistake a busy CPU for a death.
    "distributed.scheduler.allowed-failures": 0,
    "distributed.comm.timeouts.connect": "60s",
    "distributed.scheduler.worker-ttl": "15 minutes",
    "distributed.worker.daemon": True,
    "distributed.admin.tick.limit": "1h",
    "distributed.nanny.pre-spawn-environ": ENVIRON,
}


class Cluster:
    """A connection to the workers. Raises ClusterError where they do not come up within `options.timeout` seconds."""

    def __init__(self, options: Execution) -> None:
        import dask
        from distributed import Client

        self._options = options
        self._restore = contextlib.ExitStack()  # the user's own settings come back when this is closed
        self._restore.enter_context(dask.config.set(CONFIG))
        self._restore.enter_context(_environ_kept())
        self._local: Any = None
        try:
            with _no_interrupts():  # inherited: Ctrl-C is this process's alone, not its workers'
                if options.scheduler:
                    self.client = _connect(options)
                else:
                    self._local = _start(options)
                    self.client = Client(self._local, set_as_default=False, timeout=options.timeout)
            self.dashboard = str(self.client.dashboard_link)
            self.slots, self.offered = 1, dict[str, float]()
            self._update()
        except BaseException:
            self.close(at_once=True)
            raise

    def load(self, plugins: Sequence[Plugin]) -> None:
        """Import the user's modules in every worker, those that come later included."""
        if not plugins:
            return
        from distributed import WorkerPlugin

        class Loading(WorkerPlugin):
            """Travels by value: workers have no other way to know it."""

            def setup(self, worker: Any) -> None:
                for plugin in plugins:
                    plugin.load()

        self.client.register_plugin(Loading(), name="b23d-" + "-".join(plugin.module for plugin in plugins))

    def missing(self, wanted: Iterable[dict[str, float]]) -> str | None:
        """What is gone without which tasks that want these resources never end, as a sentence; None: nothing."""
        if not self._update():
            return f"scheduler {self._where}: expected it to answer, got nothing: it is gone; start it again"
        if not self.slots:
            return f"scheduler {self._where}: expected workers, got none: all are gone; start one (`dask worker`)"
        for resources in wanted:
            for name, amount in resources.items():
                if amount > self.offered.get(name, 0):
                    return f"scheduler {self._where}: expected a worker with {amount:g} {name}, got none; start one"
        return None

    def check_death(self, error: BaseException) -> None:
        """Raises ClusterError where an error that a worker gave instead of an outcome is not the worker's death."""
        from distributed.scheduler import KilledWorker

        if not isinstance(error, KilledWorker):
            raise ClusterError(
                f"workers: expected the packages and modules of this process, got {type(error).__name__}: {error}; "
                "install them there, too"
            ) from error

    def close(self, at_once: bool = False) -> None:
        """Let go of an existing cluster, end one made here; `at_once`: without waiting for its tasks."""
        if at_once and self._local is not None:
            _kill(self._local)
        with contextlib.suppress(Exception):  # a connection that is lost already
            if hasattr(self, "client"):
                self.client.close(timeout=2 if at_once else 20)
        with contextlib.suppress(Exception):
            if self._local is not None:
                self._local.close(timeout=2 if at_once else 20)
        self._restore.close()

    @property
    def connected(self) -> bool:
        return bool(self.client.status == "running")

    @property
    def _where(self) -> str:
        return self._options.scheduler or "of this machine"

    def _update(self) -> bool:
        """Ask the scheduler for its workers; False: it does not answer."""
        if not self.connected:
            return False
        try:
            known = self.client.sync(self.client.scheduler.identity, n_workers=-1, callback_timeout=10)
        except (OSError, AttributeError):  # gone, or just going: then the client has no scheduler
            return False
        workers = known["workers"].values()
        self.slots = sum(worker["nthreads"] for worker in workers)
        self.offered = {}
        for worker in workers:
            for name, amount in worker.get("resources", {}).items():
                self.offered[name] = max(amount, self.offered.get(name, 0))
        return True


def _connect(options: Execution) -> Any:
    from distributed import Client

    security = _security(options)
    try:
        client = Client(options.scheduler, set_as_default=False, timeout=options.timeout, security=security)
        client.wait_for_workers(1, timeout=options.timeout)
    except OSError as error:  # TimeoutError is one
        answered = "client" in locals()
        expected = "a worker" if answered else "it to answer"
        todo = f"start one: dask worker {options.scheduler}" if answered else "is it running, and is the address right?"
        if answered:
            client.close(timeout=2)
        raise ClusterError(
            f"scheduler {options.scheduler}: expected {expected} within {options.timeout:g} s, got none ({error}); "
            f"{todo}"
        ) from error
    return client


def _security(options: Execution) -> Any:
    """Certificates from the run file, else from dask's own settings."""
    from distributed import Security

    tls = options.tls
    if tls is None:
        security = Security()
        if str(options.scheduler).startswith("tls://") and not security.get_connection_args("client")["ssl_context"]:
            raise RunFileError(
                f"scheduler {options.scheduler}: expected certificates for tls, got none; "
                "name them in the run file's [execution.tls], or in dask's settings"
            )
        return security
    for name, path in (("ca", tls.ca), ("cert", tls.cert), ("key", tls.key)):
        if path is not None and not Path(path).is_file():
            raise FileNotFoundError(f"execution.tls.{name}: expected a PEM file, got nothing at {path}; check the path")
    return Security(
        require_encryption=True,
        tls_ca_file=str(tls.ca),
        tls_client_cert=str(tls.cert),
        tls_client_key=str(tls.key or tls.cert),
    )


def _start(options: Execution) -> Any:
    """One process a core, and `processes_per_gpu` more a GPU that alone offer `gpu`; `workers` bounds the former."""
    from distributed import Nanny, Scheduler, Security, SpecCluster

    # The cluster's own silence ends with it, but what a stop cuts short may be told after that.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    security = Security(require_encryption=False)  # on loopback; the user's dask settings are for other clusters
    shared = {"host": LOOPBACK, "dashboard_address": f"{LOOPBACK}:0", "protocol": "tcp", "security": security}
    common = {**shared, "nthreads": 1, "memory_limit": int(options.memory_gb * 2**30), "silence_logs": 60}
    count, gpus = options.workers or os.cpu_count() or 1, _gpus()
    hidden = {**ENVIRON, "CUDA_VISIBLE_DEVICES": ""} if gpus else ENVIRON
    workers = {f"cpu-{i}": {"cls": Nanny, "options": {**common, "env": hidden}} for i in range(count)}
    for gpu, i in product(gpus, range(options.processes_per_gpu)):
        workers[f"gpu-{gpu}-{i}"] = {
            "cls": Nanny,
            "options": {**common, "env": {**ENVIRON, "CUDA_VISIBLE_DEVICES": gpu}, "resources": {"gpu": 1}},
        }
    scheduler = {"cls": Scheduler, "options": shared}
    problem: Exception | None = None
    for _ in range(STARTS):
        try:
            return SpecCluster(workers=workers, scheduler=scheduler, security=security, silence_logs=60, name="b23d")
        except Exception as error:
            problem = error
    raise ClusterError(
        f"workers: expected {counted(len(workers), 'process')} to start, got one that died while starting, "
        f"{STARTS} times ({problem}); is there memory for them? Fewer: --workers, none: --workers 0"
    ) from problem


def _kill(cluster: Any) -> None:
    """End the worker processes of a local cluster now: what they have stored is whole, the rest is made again."""
    for nanny in cluster.workers.values():
        process = getattr(nanny, "process", None)
        if process is not None and process.pid is not None:
            nanny.auto_restart = False
            with contextlib.suppress(ProcessLookupError):
                os.kill(process.pid, signal.SIGKILL)


@contextmanager
def _no_interrupts() -> Iterator[None]:
    """Threads and processes started within never see SIGINT; this thread gets it afterwards."""
    sys.warnoptions.append("ignore:resource_tracker")  # its word on a process that was stopped at once
    resource_tracker.ensure_running()  # multiprocessing's; started later, it would undo the mask
    sys.warnoptions.pop()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _environ_kept() -> Iterator[None]:
    """Nannies leave their workers' environment in the process that makes them: put back what was there."""
    names = (*ENVIRON, "PYTHONHASHSEED")
    before = {name: os.environ.get(name) for name in names}
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _gpus() -> list[str]:
    """Ids of the GPUs this process may use, without loading CUDA."""
    visible = os.environ.get("CUDA_VISIBLE_DEVICES")
    if visible is not None:
        return [gpu for gpu in visible.split(",") if gpu]
    return [str(i) for i, _ in enumerate(Path("/proc/driver/nvidia/gpus").glob("*"))]
