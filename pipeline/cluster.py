"""The dask cluster that runs a run's tasks: one made here, every socket of it on loopback, or an existing one."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from b23d.schemas.runfile import Execution

LOOPBACK = "127.0.0.1"  # whoever reaches a worker's or scheduler's socket runs code in it
GIB = str(2**30)
ENVIRON = {
    # One thread a process: BLAS and torch would otherwise fight for the cores that other workers use.
    "OMP_NUM_THREADS": "1",
    "MKL_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    # Freed arrays stay in the process: dask's own 64 KiB for trimming has them faulted in again, for most of a run.
    "MALLOC_MMAP_THRESHOLD_": GIB,
    "MALLOC_TRIM_THRESHOLD_": GIB,
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


def local_cluster(options: Execution) -> Any:
    """One process a core, and one more a GPU that alone offers `gpu`; `workers` bounds the former."""
    from distributed import Nanny, Scheduler, Security, SpecCluster

    security = Security(require_encryption=False)  # on loopback; the user's dask settings are for other clusters
    shared = {"host": LOOPBACK, "dashboard_address": f"{LOOPBACK}:0", "protocol": "tcp", "security": security}
    common = {
        **shared,
        "nthreads": 1,
        "memory_limit": int(options.memory_gb * 2**30),
        "silence_logs": 50,
    }
    count, gpus = options.workers or os.cpu_count() or 1, _gpus()
    hidden = {**ENVIRON, "CUDA_VISIBLE_DEVICES": ""} if gpus else ENVIRON
    workers = {f"cpu-{i}": {"cls": Nanny, "options": {**common, "env": hidden}} for i in range(count)}
    for gpu in gpus:
        workers[f"gpu-{gpu}"] = {
            "cls": Nanny,
            "options": {**common, "env": {**ENVIRON, "CUDA_VISIBLE_DEVICES": gpu}, "resources": {"gpu": 1}},
        }
    scheduler = {"cls": Scheduler, "options": shared}
    return SpecCluster(workers=workers, scheduler=scheduler, security=security, silence_logs=50, name="b23d")


@contextmanager
def environ_kept() -> Iterator[None]:
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
