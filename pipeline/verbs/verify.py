"""`b23d verify`."""

from __future__ import annotations

import typer
from rich.markup import escape

from b23d.pipeline.verbs.options import RunPath, Set, StoreUrl
from b23d.pipeline.verbs.terminal import Checking, console


def verify(run: RunPath, set: Set = [], store: StoreUrl = None) -> None:
    """Check every digest. Damaged artifacts are named with their shapes and removed, so that the next run makes them
    again."""
    from b23d.pipeline.inspection.proposing import proposed
    from b23d.pipeline.inspection.upkeep import verify as find_damage
    from b23d.pipeline.run import Run

    loaded, count, kept = Run.load(run, set, store), 0, 0
    with Checking(console) as checking:
        for damage in find_damage(loaded, checking.watch):
            count += 1
            kept += not damage.removed
            console.print(
                f"[red]✗[/] {damage.stage} of {escape(', '.join(damage.shapes))}: {escape('; '.join(damage.problems))}"
                f"{'' if damage.removed else ' (could not be removed)'}",
                highlight=False,
                soft_wrap=True,
            )
    if count:
        console.print(
            f"{count - kept} damaged artifacts removed; `{proposed('run', loaded)}` makes them again"
            + (f"; {kept} could not be read or removed just now" if kept else ""),
            highlight=False,
            markup=False,
            soft_wrap=True,
        )
        raise typer.Exit(1)
    console.print(
        f"every artifact is what was written, in store {loaded.store.url}",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )
