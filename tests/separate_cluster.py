"""A scheduler and workers as separate processes on loopback, as `--scheduler` finds them on a real cluster."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).parents[1]


class SeparateCluster:
    """`dask scheduler` and `dask worker` processes; `tls`: their certificate options."""

    def __init__(self, folder: Path, tls: tuple[str, ...] = ()) -> None:
        self.file, self.tls = folder / "scheduler.json", tls
        protocol = ("--protocol", "tls") if tls else ()
        options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(self.file))
        self.scheduler = self._start("scheduler", *options, *protocol)
        self.workers: list[subprocess.Popen[bytes]] = []
        deadline = time.monotonic() + 60
        while not self.file.exists() or not self.file.read_text():
            assert time.monotonic() < deadline and self.scheduler.poll() is None, "the scheduler did not start"
            time.sleep(0.05)

    @property
    def address(self) -> str:
        return str(json.loads(self.file.read_text())["address"])

    def add_worker(self, *options: str) -> subprocess.Popen[bytes]:
        fixed = ("--nthreads", "1", "--no-nanny", "--host", "127.0.0.1", "--no-dashboard")
        self.workers.append(self._start("worker", self.address, *fixed, *options))
        return self.workers[-1]

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()

    def _start(self, what: str, *options: str) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-m", "dask", what, *options, *self.tls],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )


@contextmanager
def separate_cluster(folder: Path, workers: int = 1, tls: tuple[str, ...] = ()) -> Iterator[SeparateCluster]:
    cluster = SeparateCluster(folder, tls)
    try:
        for _ in range(workers):
            cluster.add_worker()
        yield cluster
    finally:
        cluster.close()
