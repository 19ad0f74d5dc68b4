"""`b23d verify`."""

from __future__ import annotations

import typer
from rich.markup import escape

from b23d.pipeline.verbs.options import RunPath, Set, StoreUrl
from b23d.pipeline.verbs.terminal import console


def verify(run: RunPath, set: Set = [], store: StoreUrl = None) -> None:
    """Check every digest. Damaged artifacts are named with their shapes and removed, so that the next run makes them
    again."""
    from b23d.pipeline.run import Run
    from b23d.pipeline.upkeep import verify as find_damage

    loaded, count = Run.load(run, set, store), 0
    with console.status("checking") as status:
        for damage in find_damage(loaded, lambda done, total: status.update(f"checking {done}/{total}")):
            count += 1
            console.print(
                f"[red]✗[/] {damage.stage} of {', '.join(damage.shapes)}: {escape('; '.join(damage.problems))}",
                highlight=False,
            )
    if count:
        console.print(
            f"{count} damaged artifacts removed; `b23d run {run}` makes them again", highlight=False, markup=False
        )
        raise typer.Exit(1)
    console.print("every artifact is what was written")
