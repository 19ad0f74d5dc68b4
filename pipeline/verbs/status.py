"""`b23d status`: which runs are going on over a store, who does what, how far, and how long it will take."""

from __future__ import annotations

import json
import time
from datetime import timedelta
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.verbs.options import Json, Set, StoreUrl
from b23d.pipeline.verbs.terminal import console

SHOWN = 4  # tasks in hand that a row names


def status(
    run: Annotated[
        Path | None, typer.Argument(metavar="[RUN]", help="Run file whose store to look into.", show_default=False)
    ] = None,
    set: Set = [],
    store: StoreUrl = None,
    as_json: Json = False,
) -> None:
    """Runs that are going on over a store, on this machine or others."""
    from b23d.pipeline.storage.roots import leases
    from b23d.pipeline.verbs.stores import store_of

    opened = store_of(run, set, store)
    told = leases(opened)
    if as_json:
        print(json.dumps(told, indent=1))
        return
    if not told:
        console.print(f"nothing is running over {opened.url}", highlight=False, markup=False)
        return
    table = Table(title=escape(f"running over {opened.url}"), title_justify="left")
    for column in ("where", "run", "done", "failed", "time left", "said", "in hand"):
        table.add_column(column, overflow="fold")
    for one in told:
        table.add_row(*map(escape, _row(one)))
    console.print(table)


def _row(told: dict[str, Any]) -> list[str]:
    progress = told.get("progress", {})
    done, total, running = progress.get("done", 0), progress.get("total", 0), progress.get("running", [])
    left = timedelta(seconds=round(progress["seconds"] / done * (total - done))) if done else "?"
    more = f" and {len(running) - SHOWN} more" if len(running) > SHOWN else ""
    return [
        f"{told.get('host')}:{told.get('pid')}",
        " ".join([str(progress.get("run", "?")), *progress.get("overrides", [])]),
        f"{done} of {total}",
        str(progress.get("failed", 0)),
        str(left),
        f"{max(0, time.time() - told.get('time', 0)):.0f} s ago",
        ", ".join(running[:SHOWN]) + more,
    ]
