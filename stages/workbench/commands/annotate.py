"""`b23d annotate`: click keypoints on a shape in a local page. The procedure is told in
`b23d.stages.workbench.annotate`."""

from __future__ import annotations

import shlex
import webbrowser
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from b23d.pipeline.inspection.proposing import proposed
from b23d.pipeline.run import Run
from b23d.pipeline.verbs.options import RunPath, Set, StoreUrl


def annotate(
    run: RunPath,
    shape: Annotated[
        str | None,
        typer.Argument(
            metavar="SHAPE", help="<class>/<id> to begin with, annotated already or not. Default: the next one needed."
        ),
    ] = None,
    set: Set = [],
    store: StoreUrl = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Of the page; 0: the system chooses.")] = 0,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
    keypoints: Annotated[
        Path | None,
        typer.Option(
            "--keypoints", metavar="FILE", help="Annotation file to write to. Default: the folder data set's own."
        ),
    ] = None,
) -> None:
    """Click keypoints on a shape, another annotated shape of its class beside it; saved in KeypointNet's JSON form."""
    from b23d.stages.workbench.annotate.server import AnnotationServer
    from b23d.stages.workbench.annotate.walk import Walk

    console = Console()
    loaded = Run.load(run, set, store)
    walk = Walk(loaded, shape, keypoints)
    session = walk.at()
    told = walk.around(session.shape.name)["told"]
    with AnnotationServer(walk, port) as server:
        console.print(f"annotate {session.shape.name} at {server.url}", highlight=False, markup=False, soft_wrap=True)
        console.print(told, highlight=False, markup=False, soft_wrap=True)
        console.print(f"saves to {session.path}; Ctrl+C here when done", highlight=False, markup=False, soft_wrap=True)
        if not session.own:
            hint = (
                shlex.join(["--set", f"dataset.keypoints={session.path}"])
                if not loaded.config.dataset.annotations_kept()
                else "a data set made of that file"
            )
            console.print(
                f"this run does not read that file: use {hint}", highlight=False, markup=False, soft_wrap=True
            )
        if browser:
            webbrowser.open(server.url)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            console.print(
                f"closed; {proposed('run', loaded)} uses what was saved" if session.own else "closed",
                markup=False,
                highlight=False,
                soft_wrap=True,
            )
