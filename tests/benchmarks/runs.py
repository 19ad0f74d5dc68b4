"""Whole runs: what the engine adds to the stages, with how many shapes, and what a second process gains."""

from __future__ import annotations

import resource
import tempfile
import time
from pathlib import Path

from b23d.pipeline.run import Run
from tests.benchmarks.measuring import Table
from tests.benchmarks.stages import encoder

RUN = """
name = "bench"
[dataset]
kind = "procedural"
classes = ["chair"]
count = {count}
[shots]
count = 3
draws = [0]
[stages.extract]
encoder = "{encoder}"
[store]
root = "store"
transient = ["render", "extract"]
"""


def runs(table: Table) -> None:
    table.title("End to end, all stages, one draw: wall seconds depend on what else the machine does")
    _run(4, 1)  # not counted: first uses of the disk's cache and of compiled code
    few, small = _run(4, 1), _run(8, 1)
    both = _run(8, 2)
    a_shape = (small[0] - few[0]) / 4
    print(f"  {'a further shape, one process':<44} {a_shape:8.3f}  s of CPU, {(small[1] - few[1]) / 4:.2f} s wall")
    table.add("8 shapes / 4 shapes, CPU", small[0] / few[0], f"{small[0]:.1f} s / {few[0]:.1f} s")
    table.add("2 processes / 1, wall", both[1] / small[1], f"{both[1]:.1f} s / {small[1]:.1f} s")
    table.add("2 processes / 1, CPU", both[0] / small[0], f"{both[0]:.1f} s / {small[0]:.1f} s")


def _run(count: int, workers: int) -> tuple[float, float]:
    """CPU seconds of all processes, and wall seconds."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bench.toml"
        path.write_text(RUN.format(count=count, encoder=encoder()))
        started, wall = _spent(), time.perf_counter()
        report = Run.load(path).execute(workers=workers)
        if not report.ok:
            failed = "\n".join(failure.error for failure in report.failures)
            raise RuntimeError(f"bench: expected {count} shapes to go through, got failures:\n{failed}")
        return _spent() - started, time.perf_counter() - wall


def _spent() -> float:
    usages = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in usages)
