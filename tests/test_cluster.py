"""The cluster a run makes: who can reach it, and what its workers' environment is."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import Any

import dask
import distributed
import numpy as np
import psutil
import pytest

from b23d.pipeline.errors import ClusterError
from b23d.pipeline.run import Run
from b23d.pipeline.scheduling.cluster import _start
from b23d.pipeline.stage import stage
from b23d.schemas.params import Params
from b23d.schemas.runfile import Execution
from tests.toy import Numbers, make_toy

ENVIRON = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS")
MALLOC = ("MALLOC_MMAP_THRESHOLD_", "MALLOC_TRIM_THRESHOLD_")


class EnvironmentParams(Params):
    """Of this module, so that workers import it."""


@stage(version=1)
def environment(numbers: Numbers, params: EnvironmentParams) -> Numbers:
    """Threads of BLAS, thresholds of malloc, as this process has them."""
    return Numbers(values=np.array([float(os.environ.get(name, "-1")) for name in (*ENVIRON, *MALLOC)]))


def sockets() -> set[tuple[int, str]]:
    """(process, address) of every internet socket on which this process tree listens."""
    here, found = psutil.Process(), set[tuple[int, str]]()
    for process in [here, *here.children(recursive=True)]:
        with suppress(psutil.NoSuchProcess):  # it has just ended
            listening = [c for c in process.net_connections(kind="inet") if c.status == psutil.CONN_LISTEN]
            found.update((process.pid, connection.laddr.ip) for connection in listening)
    return found


def test_nobody_outside_this_machine_reaches_a_local_cluster(tmp_path: Path) -> None:
    """Not the scheduler, not the dashboard, no nanny, no worker's RPC or HTTP, whatever the user's dask settings."""
    before, seen = sockets(), set[tuple[int, str]]()

    def watch(*_: Any) -> None:
        seen.update(sockets() - before)

    path = make_toy(tmp_path)
    with dask.config.set({"distributed.comm.require-encryption": True}):
        report = Run.load(path, ['outputs=["environment"]']).execute(workers=2, watch=watch)
    assert report.ok
    assert len({process for process, _ in seen}) >= 3, "this process and two workers listen"
    assert {address for _, address in seen} == {"127.0.0.1"}


def test_workers_have_one_thread_and_keep_their_memory(tmp_path: Path) -> None:
    """What a process of this run is given does not stay in the user's own."""
    before = dict(os.environ)
    run = Run.load(make_toy(tmp_path), ['outputs=["environment"]'])
    assert run.execute(workers=1).ok
    for _, _, artifact in run.collect("environment"):
        assert isinstance(artifact, Numbers)
        np.testing.assert_array_equal(artifact.values, [1, 1, 1, 2**30, 2**30])
    assert dict(os.environ) == before


def test_workers_that_die_while_starting_are_said_in_words(monkeypatch: pytest.MonkeyPatch) -> None:
    def dies(*_: Any, **__: Any) -> None:
        raise RuntimeError("Nanny failed to start")

    monkeypatch.setattr(distributed, "SpecCluster", dies)
    with pytest.raises(ClusterError, match=r"got one that died while starting.*--workers 0") as caught:
        _start(Execution(workers=3))
    assert caught.value.exit_code == 4
