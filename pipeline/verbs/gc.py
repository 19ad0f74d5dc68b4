"""`b23d gc`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from b23d.pipeline.verbs.options import DEFAULT_STORE, StoreUrl
from b23d.pipeline.verbs.terminal import console
from b23d.schemas.wording import counted

Runs = Annotated[
    list[Path] | None, typer.Argument(metavar="[RUN]…", help="Run files that count besides those the store knows.")
]


def gc(
    runs: Runs = None,
    store: StoreUrl = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would go.")] = False,
    as_written: Annotated[
        bool, typer.Option("--as-written", help="Drop what run files reach only with the --set they were run with.")
    ] = False,
) -> None:
    """Drop what no run file reaches, largest first. Run files that have used the store count, and those in runs/; what
    a running run wants is kept."""
    from b23d.pipeline.inspection.upkeep import garbage, known_run_files, reached, shape_of
    from b23d.pipeline.storage.roots import stamp
    from b23d.pipeline.store import Store

    opened = Store(store or DEFAULT_STORE)
    opened.check_is_store()
    files = {path.resolve() for path in [*known_run_files(opened), *(runs or [])]}
    besides = {path.resolve() for path in Path("runs").rglob("*.toml")} - files

    def kept() -> set[tuple[str, str]]:
        return reached(sorted(files), opened, sorted(besides), as_written)

    seen, keep = stamp(opened), kept()
    lost, dropped = garbage(opened, keep), 0
    for item in lost:
        if (now := stamp(opened)) != seen:  # a run has begun meanwhile: it may want what nobody wanted before
            seen, keep = now, kept()
        if (item.stage, item.address) in keep:
            continue
        console.print(
            f"{item.stored_bytes / 1e6:10.2f} MB  {item.stage} {item.address[:16]}  {shape_of(opened, item)}",
            highlight=False,
            markup=False,
            soft_wrap=True,
        )
        if not dry_run:
            opened.delete(item.stage, item.address)
        dropped += item.stored_bytes
    if not dry_run:
        opened.drop_leftovers()
    verb = "would drop" if dry_run else "dropped"
    console.print(
        f"{verb} {counted(len(lost), 'artifact')}, {dropped / 1e6:.1f} MB, of store {opened.url}; "
        f"{len(files | besides)} run files count",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )
