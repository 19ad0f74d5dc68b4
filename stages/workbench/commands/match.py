"""`b23d match`: one shape painted with the colours of another, by what looks alike."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from b23d.pipeline.errors import RunFileError
from b23d.pipeline.verbs.options import Set, StoreUrl
from b23d.schemas.wording import counted
from b23d.stages.correspondence.matching import Method


def match(
    a: Annotated[Path, typer.Argument(metavar="A", help="Mesh or cloud to paint.", show_default=False)],
    b: Annotated[Path, typer.Argument(metavar="B", help="Mesh or cloud that gives the colours.", show_default=False)],
    out: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="FILE", help="A with B's colours: .ply, with the matching points, or .glb."
        ),
    ] = Path("match.ply"),
    page: Annotated[
        Path | None, typer.Option("--page", metavar="FILE.html", help="Both side by side. Default: beside the former.")
    ] = None,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = False,
    method: Annotated[
        Method,
        typer.Option(
            "--method",
            help="nearest: what looks alike. consistent: mutual distances and left and right, too. smooth: one smooth "
            "map, for two poses or builds of one kind of body.",
        ),
    ] = "nearest",
    encoder: Annotated[str | None, typer.Option("--encoder", help="As stages.extract.encoder.")] = None,
    set: Set = [],
    store: StoreUrl = None,
) -> None:
    """For every vertex of A the point of B that looks alike; A is written with B's colours or texture on it.

    Where B has no colours, they say where on B each point is.
    """
    from b23d.stages.workbench.api.match_page import write_match_page
    from b23d.stages.workbench.api.matching import match as matched

    console = Console()
    if out.suffix.lower() not in (".ply", ".glb"):
        raise ValueError(
            f"-o {out}: expected a file of .ply or .glb, got {out.suffix or 'no suffix'!r}; change its name"
        )
    try:
        with console.status("describing both shapes"):
            found = matched(a, b, method=method, encoder=encoder, overrides=set, store=store)
    except RunFileError as error:
        raise RunFileError(("--" if str(error).startswith("encoder") else "") + str(error)) from error
    found.write(out)
    page = page or out.with_suffix(".html")
    write_match_page(found, (a.name, b.name), page)
    for path in (out, page):
        console.print(
            f"wrote {path} ({path.stat().st_size / 1e6:.1f} MB)", highlight=False, soft_wrap=True, markup=False
        )
    middle = float(sorted(found.similarity.tolist())[len(found.similarity) // 2])
    console.print(
        f"{counted(len(found.points), 'vertex', 'vertices')} matched, median cosine {middle:.2f}", highlight=False
    )
    if browser:
        webbrowser.open(page.resolve().as_uri())
