"""`b23d report`: one HTML page of a run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress

from b23d.pipeline.planning.nodes import State
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import load_config
from b23d.pipeline.runfile.members import members
from b23d.pipeline.runfile.overrides import Carried
from b23d.pipeline.verbs.options import RunPath, Set, StoreUrl
from b23d.schemas.wording import counted


def report(
    run: RunPath,
    set: Set = [],
    store: StoreUrl = None,
    draw: Annotated[
        int | None, typer.Option("--draw", help="Whose predictions are shown first; default: the first draw.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE.html", help="Default: report.html in the run's folder.")
    ] = None,
    inline: Annotated[
        bool | None,
        typer.Option(
            "--inline/--beside",
            show_default=False,
            help="3D views in the page, or in files beside. Default: in it below 25 MB.",
        ),
    ] = None,
    details: Annotated[
        int, typer.Option(min=0, metavar="N", help="At most N shapes with a 3D view (about 0.12 MB each).")
    ] = 500,
) -> None:
    """One HTML page: score curves, a table of shapes, 3D views with keypoints and features, stage timings, failures.

    A run file with a [sweep] or [variants] table also gets the comparison page of what is stored of them.
    """
    from b23d.stages.workbench.report.writing import write_report

    console = Console()
    series = load_config(run, map(Carried, set))
    loaded = Run(series if members(series) else load_config(run, set), store)
    compared = _compare(console, loaded, run, store)
    if compared and not any(node.state is State.CACHED for node in loaded.plan().nodes.values()):
        return  # the run itself was never run, only what is compared
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("shapes", total=None)
        made = write_report(
            loaded, out, inline, details, draw, lambda done, total: progress.update(task, completed=done, total=total)
        )
    views = "every shape" if made.detailed == made.shapes else f"{made.detailed} of {counted(made.shapes, 'shape')}"
    console.print(
        f"wrote {made.page} ({made.page_bytes / 1e6:.1f} MB), 3D views of {views}", highlight=False, soft_wrap=True
    )
    if made.folder is not None:
        console.print(
            f"keep {made.folder} ({made.folder_bytes / 1e6:.0f} MB) beside it, or use --inline",
            highlight=False,
            soft_wrap=True,
        )


def _compare(console: Console, loaded: Run, run: Path, store: str | None) -> bool:
    """Write the comparison page, where the run file has something to compare."""
    from b23d.stages.workbench.report.comparison import write_comparison
    from b23d.stages.workbench.results.comparing import compare

    listed = members(loaded.config)
    if not listed:
        return False
    page = write_comparison(loaded.config, compare(run, listed, store), loaded.folder)
    console.print(f"wrote {page} ({page.stat().st_size / 1e6:.1f} MB)", highlight=False, markup=False, soft_wrap=True)
    return True
