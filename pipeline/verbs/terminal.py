"""Where verbs print, and how much."""

from __future__ import annotations

import time
from dataclasses import dataclass

from rich.console import Console

EVERY = 10.0  # seconds between two lines of progress, where no terminal shows it in place

console = Console()
if not console.is_terminal:
    console = Console(width=120)  # into a file or a pipe, tables keep their columns


class Checking:
    """How far a long check is: in place on a terminal, a line every `EVERY` seconds elsewhere. A context manager."""

    def __init__(self, console: Console) -> None:
        self.console, self._status = console, console.status("checking")
        self._said = time.monotonic()

    def __enter__(self) -> Checking:
        self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._status.stop()

    def watch(self, done: int, total: int) -> None:
        """`done` of `total` are checked."""
        if self.console.is_terminal:
            self._status.update(f"checking {done}/{total}")
        elif time.monotonic() - self._said > EVERY or done == total:
            self._said = time.monotonic()
            self.console.print(f"checked {done} of {total}", highlight=False)


@dataclass
class Debug:
    """`--debug`: tracebacks are shown."""

    on: bool = False


debug = Debug()
