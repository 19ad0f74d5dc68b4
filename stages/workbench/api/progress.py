"""Progress of `execute` in a notebook: one line that changes in place."""

from __future__ import annotations

import html
import sys
import time
from collections import Counter
from typing import Any

from b23d.pipeline.planning.nodes import State
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.scheduling.tasks import Outcome, Task
from b23d.schemas.wording import counted

EVERY = 0.5  # seconds between two changes


def in_notebook() -> bool:
    """Whether a kernel that shows HTML is running this."""
    shell = sys.modules.get("IPython")
    return shell is not None and getattr(shell.get_ipython(), "kernel", None) is not None


class NotebookProgress:
    """`start` and `watch` are `Run.execute`'s callbacks."""

    def __init__(self) -> None:
        self._handle: Any = None
        self._done: Counter[str] = Counter()
        self._total: Counter[str] = Counter()
        self._failed, self._began, self._shown = 0, time.monotonic(), 0.0

    def start(self, plan: Plan, address: str) -> None:
        self._total.update({stage: counts[State.RUN] for stage, counts in plan.count().items()})
        self._show()

    def watch(self, plan: Plan, outcome: Outcome | Task) -> None:
        if isinstance(outcome, Task):
            return
        self._done[outcome.stage] += 1
        self._failed += outcome.failure is not None
        if time.monotonic() - self._shown > EVERY or self._done.total() == self._total.total():
            self._show()

    def text(self) -> str:
        """The line: all tasks, time gone, and the stages that are under way."""
        done, total = self._done.total(), self._total.total()
        stages = [
            f"{stage} {self._done[stage]}/{count}"
            for stage, count in self._total.items()
            if count and 0 < self._done[stage] < count
        ]
        failed = [f"{self._failed} failed"] if self._failed else []
        return " · ".join(
            [f"{done} of {counted(total, 'task')}, {time.monotonic() - self._began:.0f} s", *failed, *stages]
        )

    def _show(self) -> None:
        from IPython.display import HTML, display

        self._shown = time.monotonic()
        share = self._done.total() / max(1, self._total.total())
        bar = f'<progress value="{share:.3f}"></progress> {html.escape(self.text())}'
        if self._handle is None:
            self._handle = display(HTML(bar), display_id=True)
        else:
            self._handle.update(HTML(bar))
