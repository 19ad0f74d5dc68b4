"""`run.log` in a run's folder: every task's outcome, and what its libraries printed and warned of."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from pathlib import Path
from typing import IO, TypeVar

from b23d.pipeline.planning.nodes import State
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.scheduling.tasks import Outcome, Task

T = TypeVar("T")


def both(first: Callable[[Plan, T], None], second: Callable[[Plan, T], None]) -> Callable[[Plan, T], None]:
    """One callback that calls two."""

    def call(plan: Plan, what: T) -> None:
        first(plan, what)
        second(plan, what)

    return call


class RunLog:
    """One line a task, what belongs to it indented below. A log that cannot be written stops nothing."""

    def __init__(self, folder: Path, name: str, selected: str = "") -> None:
        self._name, self._asked = name, f"; {selected}" * bool(selected)
        self._file: IO[str] | None = None
        with contextlib.suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            self._file = (folder / "run.log").open("a", encoding="utf-8", buffering=1)

    def __enter__(self) -> RunLog:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        self._write(f"ended   {kind.__name__}: {error}" if kind is not None else "ended")
        if self._file is not None:
            with contextlib.suppress(OSError):
                self._file.close()

    def start(self, plan: Plan, address: str) -> None:
        cached = sum(counts[State.CACHED] for counts in plan.count().values())
        self._write(f"run     {self._name}: {len(plan.to_run())} to run, {cached} stored; on {address}{self._asked}")

    def watch(self, plan: Plan, what: Outcome | Task) -> None:
        if isinstance(what, Task):
            return
        cost = f"{what.seconds:.3f} s, {1000 * what.overhead:.0f} ms beside, peak {what.peak_mb:.0f} MB"
        if what.failure is None:
            self._write(f"done    {what.stage} of {what.shape}: {cost}, {what.stored_bytes / 1e6:.3f} MB stored")
        else:
            self._write(f"failed  {what.stage} of {what.shape}: {what.failure.error}; {cost}")
            self._indented(what.failure.traceback)
        self._indented(what.said)

    def _indented(self, text: str) -> None:
        for line in text.splitlines():
            self._put(f"    | {line.rstrip()}\n")

    def _write(self, text: str) -> None:
        self._put(f"{time.strftime('%Y-%m-%dT%H:%M:%S%z')} {text}\n")

    def _put(self, text: str) -> None:
        if self._file is not None:
            with contextlib.suppress(OSError, ValueError):
                self._file.write(text)
