"""What the engine itself costs: eight stages that do nothing over N shapes (argument, 500), on two worker processes.

Prints milliseconds of CPU a stage in the workers and in this process, peak memory of both, and the re-run.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from b23d.pipeline.run import Run
from b23d.pipeline.scheduling.memory import peak_mb, reset_peak
from tests.toy import make_idle

WORKERS = 2


def cpu(who: int) -> float:
    used = resource.getrusage(who)
    return used.ru_utime + used.ru_stime


def main(count: int) -> None:
    reset_peak()
    with tempfile.TemporaryDirectory() as folder:
        path = make_idle(Path(folder), count)
        run = Run.load(path)
        started = cpu(resource.RUSAGE_SELF)
        tasks = len(run.plan().to_run())
        planning = cpu(resource.RUSAGE_SELF) - started
        idle = make_idle(Path(folder), 1, store="warm")
        Run.load(idle, ["dataset.count=2"]).execute(workers=WORKERS)  # what starting workers costs is not asked here
        start_up = cpu(resource.RUSAGE_CHILDREN)
        started, wall = cpu(resource.RUSAGE_SELF), time.perf_counter()
        report = run.execute(workers=WORKERS)
        wall, client = time.perf_counter() - wall, cpu(resource.RUSAGE_SELF) - started
        workers = cpu(resource.RUSAGE_CHILDREN) - 2 * start_up
        assert report.ok and len(report.done) == tasks
        again = cpu(resource.RUSAGE_SELF)
        assert Run.load(path).execute(workers=WORKERS).done == []
        again = cpu(resource.RUSAGE_SELF) - again
    client_mb = peak_mb()
    worker = max(outcome.peak_mb for outcome in report.done)
    print(f"{count} shapes, {tasks} tasks: planned in {planning:.2f} s CPU; {wall:.1f} s wall")
    print(f"a stage: {1000 * workers / tasks:.2f} ms CPU in a worker, {1000 * client / tasks:.2f} ms in the client")
    print(f"peak memory: client with scheduler {client_mb:.0f} MB, a task in a worker {worker:.0f} MB")
    print(f"re-run {again:.2f} s CPU")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 500)
