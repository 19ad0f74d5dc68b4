"""Progress of a run: one bar a stage, failures as they come, and a table at the end."""

from __future__ import annotations

from collections import Counter, defaultdict

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table

from b23d.pipeline.plan import Plan, State
from b23d.pipeline.run import Report
from b23d.pipeline.stopping import Stopped
from b23d.pipeline.tasks import Outcome

WANTED = (State.CACHED, State.RUN, State.BLOCKED)


class RunProgress:
    """Watches `Run.execute`. Use as a context manager; `start` and `watch` are its callbacks."""

    def __init__(self, console: Console) -> None:
        self.console = console
        name, note = TextColumn("{task.description:<12}"), TextColumn("{task.fields[note]}")
        self._progress = Progress(name, BarColumn(), MofNCompleteColumn(), note, TimeRemainingColumn(), console=console)
        self._bars: dict[str, TaskID] = {}
        self._seconds: dict[str, list[float]] = defaultdict(list)
        self._failed: Counter[str] = Counter()
        self._stored = self._wanted = 0

    def __enter__(self) -> RunProgress:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> None:
        self._progress.stop()
        if isinstance(error, Stopped):
            state = f"{self._stored} of {self._wanted} stored" if self._wanted else "nothing was planned yet"
            error.text = f"stopped: {state}; run again to go on"

    def start(self, plan: Plan, address: str) -> None:
        self.console.print(f"[dim]{len(plan.to_run())} to run; dashboard: {escape(address)}[/]", highlight=False)
        counts, inlined = plan.count(), plan.inlined()
        self._stored = sum(states[State.CACHED] for states in counts.values())
        self._wanted = sum(n for states in counts.values() for state, n in states.items() if state in WANTED)
        for stage in plan.stages:
            total = counts[stage][State.RUN]
            if total:
                self._bars[stage] = self._progress.add_task(stage, total=total, note="")
            elif inlined[stage]:
                self.console.print(
                    f"[dim]{stage}: {inlined[stage]} inside their consumers (transient)[/]", highlight=False
                )
        self._progress.start()

    def watch(self, plan: Plan, outcome: Outcome | None) -> None:
        if outcome is None:
            return
        if outcome.failure is not None:
            self._failed[outcome.stage] += 1
            self._progress.console.print(f"[red]✗[/] {outcome.stage}: {escape(outcome.failure.error)}", highlight=False)
        else:
            self._stored += 1
            self._seconds[outcome.stage].append(outcome.seconds)
        seconds, failed = self._seconds[outcome.stage], self._failed[outcome.stage]
        note = f"{sum(seconds) / len(seconds):.2f} s each" if seconds else ""
        note += f" [red]{failed} failed[/]" if failed else ""
        self._progress.update(self._bars[outcome.stage], advance=1, note=note)


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
