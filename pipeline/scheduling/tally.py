"""Tally: what a run has to do, has done and is doing, and how long the rest may take."""

from __future__ import annotations

import time
from collections import Counter, defaultdict

from b23d.pipeline.planning.nodes import State
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.scheduling.tasks import Outcome, Task

WANTED = (State.CACHED, State.RUN, State.BLOCKED)


class Tally:
    def __init__(self) -> None:
        self.began = time.monotonic()
        self.stored = self.wanted = 0
        """Artifacts in the store, and those that the run wants there."""
        self.total: Counter[str] = Counter()
        """Stage → tasks of this execution."""
        self.done: Counter[str] = Counter()
        self.failed: Counter[str] = Counter()
        self.given: Counter[str] = Counter()
        """Stage → tasks that are with a worker."""
        self._seconds: dict[str, float] = defaultdict(float)

    def plan(self, plan: Plan) -> None:
        """A plan is made, or made anew."""
        counts = plan.count()
        self.stored = sum(states[State.CACHED] for states in counts.values())
        self.wanted = sum(n for states in counts.values() for state, n in states.items() if state in WANTED)
        self.given.clear()
        for stage, states in counts.items():
            if states[State.RUN] or self.done[stage]:
                self.total[stage] = states[State.RUN] + self.done[stage] + self.failed[stage]

    def hear(self, what: Outcome | Task) -> None:
        if isinstance(what, Task):
            self.given[what.stage] += 1
            return
        if what.spared:
            self.stored += 1
            self.total[what.stage] -= 1
            return
        self.given[what.stage] -= 1
        if what.failure is not None:
            self.failed[what.stage] += 1
        else:
            self.stored += 1
            self.done[what.stage] += 1
            self._seconds[what.stage] += what.seconds

    def each(self, stage: str) -> float | None:
        """Mean seconds of a stage's tasks."""
        return self._seconds[stage] / self.done[stage] if self.done[stage] else None

    def running(self) -> list[str]:
        return [stage for stage in self.total if self.given[stage] > 0]

    def seconds_left(self) -> float | None:
        """At the pace so far, each stage's tasks taken for as long as they were; None: nothing is done yet."""
        known = {stage: mean for stage in self.total if (mean := self.each(stage)) is not None}
        if not known:
            return None
        usual = sum(known.values()) / len(known)
        past = sum(self.done[stage] * mean for stage, mean in known.items())
        left = {stage: self.total[stage] - self.done[stage] - self.failed[stage] for stage in self.total}
        ahead = sum(max(0, count) * known.get(stage, usual) for stage, count in left.items())
        return (time.monotonic() - self.began) * ahead / past if past else None

    def line(self) -> str:
        """All of it in one line."""
        if not self.total:
            return f"planning for {span(time.monotonic() - self.began)}"
        done, failed, seconds = self.done.total(), self.failed.total(), time.monotonic() - self.began
        parts = [f"{done} of {self.total.total()} done" + (f", {failed} failed" if failed else "")]
        if done:
            parts.append(f"{done / seconds:.3g} a second")
        if (left := self.seconds_left()) is not None:
            parts.append(f"about {span(left)} left")
        if running := self.running():
            parts.append(f"running: {', '.join(running)}")
        return "; ".join(parts)


def span(seconds: float) -> str:
    """A length of time in words: 40 s, 12 min, 3 h 20 min."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 100 else f"{minutes // 60} h {minutes % 60} min"
