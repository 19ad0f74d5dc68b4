"""Progress of a run: bars on a terminal, a line every so often elsewhere, failures as they come, a table at the end."""

from __future__ import annotations

import threading
import time
from collections import defaultdict

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TaskID, TextColumn
from rich.table import Table

from b23d.pipeline.planning.draws import draw_notes
from b23d.pipeline.planning.nodes import MISSING, State
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.scheduling.execution import Report
from b23d.pipeline.scheduling.stopping import Stopped
from b23d.pipeline.scheduling.tally import Tally, span
from b23d.pipeline.scheduling.tasks import Outcome, Task
from b23d.pipeline.storage.index import Failure

EVERY = 20.0  # seconds between lines where there is no terminal
LATER = 60.0  # and after ten of them


class RunProgress:
    """Watches `Run.execute`. Use as a context manager; `start` and `watch` are its callbacks."""

    def __init__(self, console: Console, every: float = EVERY, verbose: bool = False, tracebacks: bool = False) -> None:
        """`verbose`: every task gets a line when it is done; `tracebacks`: what failed is told with its own."""
        self.console, self.verbose, self.tracebacks = console, verbose, tracebacks
        self.told: set[tuple[str, str]] = set()
        """(stage, address) of what has been said to have failed."""
        self.tally = Tally()
        self._bars = _Bars(console) if console.is_terminal else None
        self._every, self._ended = every, threading.Event()

    def __enter__(self) -> RunProgress:
        if self._bars is None:
            threading.Thread(target=self._tell, daemon=True).start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        self._ended.set()
        if self._bars is not None:
            self._bars.progress.stop()
        if isinstance(error, Stopped):
            stored, wanted = self.tally.stored, self.tally.wanted
            state = f"{stored} of {wanted} stored" if wanted else "nothing was planned yet"
            error.text = f"stopped: {state}; run again to go on"

    def start(self, plan: Plan, address: str) -> None:
        self.tally.plan(plan)
        self.console.print(f"[dim]{to_run(plan)}; dashboard: {escape(address)}[/]", highlight=False)
        for note in draw_notes(plan.draws):
            self.console.print(f"[yellow]![/] {escape(note)}", highlight=False, soft_wrap=True)
        for stage, count in plan.inlined().items():
            self.console.print(f"[dim]{stage}: {count} inside their consumers (transient)[/]", highlight=False)
        if self._bars is not None:
            self._bars.show(self.tally)
            self._bars.progress.start()

    def watch(self, plan: Plan, what: Outcome | Task) -> None:
        self.tally.hear(what)
        if isinstance(what, Outcome) and what.failure is not None:
            self.fail(what.failure)
        elif isinstance(what, Outcome) and self.verbose:
            line = f"{what.stage} of {what.shape}: {what.seconds:.2f} s, {what.peak_mb:.0f} MB"
            self.console.print(line, highlight=False, markup=False, soft_wrap=True)
        if self._bars is not None:
            self._bars.show(self.tally, what.stage)

    def fail(self, failure: Failure) -> None:
        """Say what failed, once."""
        if self.console.quiet or (failure.stage, failure.address) in self.told:
            return
        if failure.address != MISSING:  # of what has no address there may be several
            self.told.add((failure.stage, failure.address))
        self.console.print(f"[red]✗[/] {failure.stage}: {escape(failure.error)}", highlight=False, soft_wrap=True)
        if self.tracebacks and failure.traceback:
            self.console.print(failure.traceback, highlight=False, markup=False)

    def _tell(self) -> None:
        lines = 0
        while not self._ended.wait(self._every if lines < 10 else max(self._every, LATER)):
            lines += 1
            self.console.print(f"{time.strftime('%H:%M:%S')}  {self.tally.line()}", highlight=False, markup=False)


class _Bars:
    """One bar for all, with the time left, and one a stage; those at work turn."""

    def __init__(self, console: Console) -> None:
        name, note = TextColumn("{task.description:<12}"), TextColumn("{task.fields[note]}")
        self.progress = Progress(
            SpinnerColumn(finished_text=" "), name, BarColumn(), MofNCompleteColumn(), note, console=console
        )
        self._bars: dict[str, TaskID] = {}

    def show(self, tally: Tally, stage: str | None = None) -> None:
        """Bring the bars (or the one of a stage) and that for all up to date."""
        left = tally.seconds_left()
        self._set(
            "all", tally.done.total(), tally.total.total(), f"about {span(left)} left" if left is not None else ""
        )
        for name in [stage] if stage else tally.total:
            mean, failed = tally.each(name), tally.failed[name]
            note = [f"{mean:.2f} s each"] if mean is not None else []
            note += ["running"] if tally.given[name] > 0 else []
            note += [f"[red]{failed} failed[/]"] if failed else []
            self._set(name, tally.done[name] + failed, tally.total[name], ", ".join(note))

    def _set(self, name: str, done: int, total: int, note: str) -> None:
        if name not in self._bars:
            self._bars[name] = self.progress.add_task(name, total=total, note=note)
        self.progress.update(self._bars[name], completed=done, total=total, note=note)


def to_run(plan: Plan) -> str:
    """How many tasks a plan has to run, and how many of them may turn out not to be needed."""
    behind = plan.behind()
    sure = f"{len(plan.to_run()) - behind} to run"
    return f"{sure}, at most {behind} behind them" if behind else sure


def spared(report: Report) -> str:
    """What needed not run after all, in words; empty where that is nothing."""
    if not report.spared:
        return ""
    seconds = sum(outcome.seconds for outcome in report.spared)
    return f"{len(report.spared)} spared ({seconds:,.1f} s): what they are made of came out as it was"


def failed(report: Report) -> str:
    """How much failed, and what became of the rest, in words; empty where nothing did."""
    if report.ok:
        return ""
    counts = [
        f"{number} {word}" for number, word in ((len(report.failures), "failed"), (report.blocked, "blocked")) if number
    ]
    there = report.plan is not None and any(node.state is State.CACHED for node in report.plan.nodes.values())
    rest = "the rest is done" if there else "nothing could be done"
    return f"{', '.join(counts)}; {rest}. The next run retries only what failed"


def stage_table(report: Report) -> Table:
    """What each stage did: how many, seconds each (median, worst), peak memory, bytes."""
    table = Table(title="stages", title_justify="left")
    for column in ("stage", "done", "s median", "s worst", "overhead ms", "peak MB", "MB each"):
        table.add_column(column, justify="left" if column == "stage" else "right")
    by_stage: dict[str, list[Outcome]] = defaultdict(list)
    for outcome in report.done:
        by_stage[outcome.stage].append(outcome)
    for stage, done in by_stage.items():
        seconds = sorted(outcome.seconds for outcome in done)
        overhead = 1000 * sum(outcome.overhead for outcome in done) / len(done)
        size = sum(outcome.stored_bytes for outcome in done) / len(done) / 1e6
        peak = max(outcome.peak_mb for outcome in done)
        middle = seconds[len(seconds) // 2]
        table.add_row(
            stage,
            f"{len(done)}",
            f"{middle:.3f}",
            f"{seconds[-1]:.3f}",
            f"{overhead:.0f}",
            f"{peak:.0f}",
            f"{size:.2f}",
        )
    return table
