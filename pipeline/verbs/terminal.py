"""Where verbs print, and how much."""

from __future__ import annotations

from dataclasses import dataclass

from rich.console import Console

console = Console()
if not console.is_terminal:
    console = Console(width=120)  # into a file or a pipe, tables keep their columns


@dataclass
class Debug:
    """`--debug`: tracebacks are shown."""

    on: bool = False


debug = Debug()
