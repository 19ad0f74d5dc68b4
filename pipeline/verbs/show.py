"""`b23d show`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from b23d.pipeline.verbs.options import Draw, RunPath, Set, StoreUrl
from b23d.pipeline.verbs.terminal import console


def show(
    run: RunPath,
    shape: str,
    stage: str,
    set: Set = [],
    store: StoreUrl = None,
    draw: Draw = None,
    export: Annotated[
        Path | None, typer.Option(help="Write it: .npz, .ply, .glb, .png, .parquet (what the artifact allows).")
    ] = None,
    picture: Annotated[
        bool | None, typer.Option("--picture/--no-picture", show_default=False, help="Default: in a terminal.")
    ] = None,
) -> None:
    """What an artifact holds: a picture, arrays, ranges, provenance."""
    from b23d.pipeline.inspection import artifact_tables, export_artifact, thumbnail
    from b23d.pipeline.run import Run

    loaded = Run.load(run, set, store)
    if export is not None:
        export_artifact(loaded, shape, stage, draw, export)
        console.print(f"wrote {export} ({export.stat().st_size / 1e6:.2f} MB)", highlight=False)
    else:
        for part in artifact_tables(loaded, shape, stage, draw):
            console.print(part)
        if console.is_terminal if picture is None else picture:
            console.print(thumbnail(loaded, shape, stage, draw, console.width) or "")
