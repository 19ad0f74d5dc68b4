"""CPU seconds and peak memory of pieces of work, and a table of them beside what earlier runs of this file gave."""

from __future__ import annotations

import csv
import multiprocessing
import resource
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any, TypeVar

Result = TypeVar("Result")
HISTORY = Path(__file__).with_name("history.csv")
SLOWER = 1.3
"""Times the median of the last records: above it a figure is called slower. Ratios vary by a tenth or two."""
RED, PLAIN = "\033[31m", "\033[0m"


def seconds(work: Callable[[], Result], repeats: int = 3) -> tuple[float, Result]:
    """Median CPU seconds of this process, all of its threads, and the result; of several times, the first not counted:
    it loads what the others have."""
    times = []
    for _ in range(repeats + (repeats > 1)):
        started = time.process_time()
        result = work()
        times.append(time.process_time() - started)
    return median(times[-repeats:]), result


def in_a_process(work: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    """What `work` gives in a fresh process, and that process's peak memory in GB."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return pool.apply(_with_peak, (work, *arguments))


def _with_peak(work: Callable[..., Any], *arguments: Any) -> tuple[Any, float]:
    result, status = work(*arguments), Path("/proc/self/status")
    if not status.exists():
        return result, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    lines = dict(line.split(":", 1) for line in status.read_text().splitlines())
    return result, int(lines["VmHWM"].split()[0]) / 2**20  # ru_maxrss of Linux begins with the parent's


class Table:
    """Figures by name: printed as they come, marked where they are slower than before, recorded at the end."""

    def __init__(self, history: Path = HISTORY) -> None:
        self.history, self.figures = history, dict[str, float]()
        self.before: dict[str, list[float]] = {}
        if history.is_file():
            with history.open(newline="") as file:
                for row in csv.DictReader(file):
                    self.before.setdefault(row["figure"], []).append(float(row["value"]))

    def title(self, text: str) -> None:
        print(f"\n{text}", flush=True)

    def add(self, name: str, value: float, note: str = "") -> None:
        """A machine-neutral figure, less is better: a ratio of times on this machine, or gigabytes."""
        self.figures[name] = value
        print(f"  {name:<44} {value:8.3f}  {note}{self._mark(name, value)}", flush=True)

    def slower(self) -> list[str]:
        return [name for name, value in self.figures.items() if self._mark(name, value)]

    def record(self, day: str, commit: str) -> None:
        """Appends every figure to the history."""
        fresh = not self.history.is_file()
        with self.history.open("a", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            if fresh:
                writer.writerow(["date", "commit", "figure", "value"])
            writer.writerows([day, commit, name, f"{value:.4g}"] for name, value in self.figures.items())

    def _mark(self, name: str, value: float) -> str:
        last = self.before.get(name, [])[-3:]
        if not last or value <= SLOWER * median(last):
            return ""
        return f" {RED}slower by × {value / median(last):.2f} than {median(last):.3g}{PLAIN}"
