"""`b23d gc`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from b23d.pipeline.verbs.options import DEFAULT_STORE, StoreUrl
from b23d.pipeline.verbs.terminal import console


def gc(
    runs: Annotated[
        list[Path] | None, typer.Argument(metavar="[RUN]…", help="Run files that count besides those the store knows.")
    ] = None,
    store: StoreUrl = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would go.")] = False,
) -> None:
    """Drop what no run file reaches, largest first. Run files that have used the store count, and those in runs/."""
    from b23d.pipeline.index import Index
    from b23d.pipeline.store import Store
    from b23d.pipeline.upkeep import garbage, reached

    opened = Store(store or DEFAULT_STORE)
    known = Index(Path(opened.root) / "index.sqlite").run_files() if opened.local and Path(opened.root).is_dir() else []
    files = {path.resolve() for path in [*known, *(runs or [])]}
    besides = {path.resolve() for path in Path("runs").rglob("*.toml")} - files
    lost = garbage(opened, reached(sorted(files), opened, sorted(besides)))
    for item in lost:
        console.print(
            f"{item.stored_bytes / 1e6:10.2f} MB  {item.stage} {item.address[:16]}", highlight=False, markup=False
        )
        if not dry_run:
            opened.delete(item.stage, item.address)
    total = sum(item.stored_bytes for item in lost) / 1e6
    verb = "would drop" if dry_run else "dropped"
    console.print(
        f"{verb} {len(lost)} artifacts, {total:.1f} MB; {len(files | besides)} run files count", highlight=False
    )
