"""Arguments and options that several verbs take, each declared once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

DEFAULT_STORE = "runs/.store"
"""Where verbs without a run file look."""
RunPath = Annotated[Path, typer.Argument(metavar="RUN", help="Run file (TOML).", show_default=False)]
Set = Annotated[
    list[str], typer.Option("--set", metavar="a.b=value", help="Override anything the run file says; repeatable.")
]
StoreUrl = Annotated[str | None, typer.Option("--store", metavar="PATH|URL", help="Another store than the run file's.")]
Limit = Annotated[int | None, typer.Option("--limit", min=1, help="Only each class's first N shapes as targets.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Say only what went wrong.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Say what becomes of every task.")]
Json = Annotated[bool, typer.Option("--json", help="Machine-readable.")]
DrawOption = Annotated[int | None, typer.Option("--draw", help="Which draw of shots; default: the first that has it.")]
Shapes = Annotated[
    list[str],
    typer.Option("--shape", metavar="NAME|GLOB|@FILE", help="Only these shapes; repeatable.", show_default=False),
]
Classes = Annotated[
    list[str], typer.Option("--class", metavar="NAME|GLOB", help="Only these classes; repeatable.", show_default=False)
]
Stages = Annotated[
    list[str],
    typer.Option("--stage", metavar="STAGE", help="Only this stage's tasks; repeatable.", show_default=False),
]
Until = Annotated[
    str | None, typer.Option("--until", metavar="STAGE", help="Up to this stage and no further.", show_default=False)
]
OnlyFailed = Annotated[bool, typer.Option("--only-failed", help="Only shapes that failed before.")]
Force = Annotated[bool, typer.Option("--force", help="Make what is selected again, although it is stored.")]
Workers = Annotated[
    int | None, typer.Option(min=0, help="Worker processes; 0: run in this process. Default: one a core.")
]
