"""`b23d show`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from b23d.pipeline.errors import SelectionError
from b23d.pipeline.inspection.artifact import FrameName, artifact_tables, export_artifact, thumbnail
from b23d.pipeline.verbs.listing import shapes_table, stages_table
from b23d.pipeline.verbs.options import DrawOption, RunPath, Set, StoreUrl
from b23d.pipeline.verbs.terminal import console


def show(
    run: RunPath,
    shape: Annotated[str | None, typer.Argument(metavar="[SHAPE]", help="Without: all are listed.")] = None,
    stage: Annotated[str | None, typer.Argument(metavar="[STAGE]", help="Without: those of the shape.")] = None,
    set: Set = [],
    store: StoreUrl = None,
    draw: DrawOption = None,
    export: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write it: .npz, .ply, .glb, .obj, .png, .parquet (what the artifact allows)."
        ),
    ] = None,
    frame: Annotated[
        FrameName, typer.Option(help="Of what is exported: the shape's own file's coordinates, or the unit frame.")
    ] = "file",
    picture: Annotated[
        bool | None, typer.Option("--picture/--no-picture", show_default=False, help="Default: in a terminal.")
    ] = None,
) -> None:
    """What an artifact holds: a picture, arrays, ranges, provenance."""
    from b23d.pipeline.inspection.listing import list_shapes
    from b23d.pipeline.run import Run

    loaded = Run.load(run, set, store)
    if shape is None or stage is None:
        if export is not None:
            raise SelectionError("--export: expected SHAPE and STAGE, got no stage; b23d list RUN says what there is")
        console.print(shapes_table(list_shapes(loaded)) if shape is None else stages_table(loaded, shape))
        return
    if export is not None:
        for path in export_artifact(loaded, shape, stage, draw, export, frame):
            size = path.stat().st_size / 1e6
            console.print(f"wrote {path} ({size:.2f} MB)", highlight=False, soft_wrap=True, markup=False)
    else:
        for part in artifact_tables(loaded, shape, stage, draw):
            console.print(part)
        if console.is_terminal if picture is None else picture:
            console.print(thumbnail(loaded, shape, stage, draw, console.width) or "")
