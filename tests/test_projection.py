"""What `plan` says of memory: the worst of the history, and what of it this machine can hold."""

from __future__ import annotations

from pathlib import Path

import pytest

from b23d.pipeline.inspection import projection
from b23d.pipeline.inspection.projection import free_mb, memory_line, project
from b23d.pipeline.run import Run
from b23d.schemas.runfile import Execution
from tests.toy import make_toy


def test_the_peak_is_the_worst_that_was_measured(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    first = project(Run.load(path), Run.load(path).plan())
    assert {row["peak_mb"] for row in first.values()} == {None}, "nothing has run yet"
    Run.load(path).execute(workers=0)
    run = Run.load(path, ["stages.square.power=3"])
    worst = {stage: max(peak for *_, peak in run.index.history(stage)) for stage in run.config.stages}
    rows = project(run, run.plan())
    assert {stage: row["peak_mb"] for stage, row in rows.items()} == {s: round(peak, 1) for s, peak in worst.items()}
    cached = project(Run.load(path), Run.load(path).plan())
    assert {row["peak_mb"] for row in cached.values()} == {0.0}, "nothing is to run"


@pytest.mark.parametrize(
    ("workers", "memory", "said"),
    [
        (3, 4.0, "enough for 5 workers"),
        (8, 4.0, "enough for 5 workers; too few for 8: --workers 5"),
        (3, 1.0, "a worker may have 1,024 MB: raise execution.memory_gb"),
    ],
)
def test_what_this_machine_can_hold(monkeypatch: pytest.MonkeyPatch, workers: int, memory: float, said: str) -> None:
    monkeypatch.setattr(projection, "free_mb", lambda: 10_700.0)
    line = memory_line({"a": {"peak_mb": 2000.0}, "b": {"peak_mb": None}}, Execution(workers=workers, memory_gb=memory))
    assert line is not None and line.endswith(said) and "2,000 MB a worker (a)" in line


def test_of_what_never_ran_nothing_is_said() -> None:
    assert memory_line({"a": {"peak_mb": None}}, Execution()) is None and memory_line({}, Execution()) is None


def test_this_machine_has_memory() -> None:
    free = free_mb()
    assert free is None or free > 100
