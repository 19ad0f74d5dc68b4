"""`b23d ablate`: from one setting of the stages to another, one field at a time, each step scored; all that is
unchanged is re-used.

A field can take a detour: first to a value of its own, and to the goal's last, so that all others are seen there. The
paper's objective is such a place: the published optimiser is too slow to be run at every step, and the posterior method
has none of its fields.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from b23d.pipeline.runfile.config import load_config, refuse_unused
from b23d.pipeline.runfile.members import Member
from b23d.pipeline.runfile.overrides import Carried
from b23d.pipeline.verbs.options import Limit, Set, StoreUrl, Workers
from b23d.stages.workbench.results.changes import members, way
from b23d.stages.workbench.results.series import run_series, series_json, series_plot, series_table

DETOURS = ["stages.optimize.method=discrete", "stages.optimize.presence=all"]
"""By the paper's own objective, solved fast, which has no evidence for absence."""


def ablate(
    run: Annotated[
        Path,
        typer.Argument(
            metavar="RUN",
            help="Run file: its data set, shots, and all stage parameters that the two "
            "settings have in common (the encoder, say) are used.",
        ),
    ],
    origin: Annotated[str, typer.Option("--from", help="Run file, or the name of one beside RUN.")] = "released",
    goal: Annotated[str, typer.Option("--to", help="Run file, or the name of one beside RUN.")] = "corrected",
    via: Annotated[
        list[str],
        typer.Option(
            "--via",
            metavar="a.b=value",
            help="A detour: this field takes this value first, and the goal's last, so that the steps between "
            "are seen there; repeatable, '' for none. Only fields that differ between the two settings take one.",
        ),
    ] = DETOURS,
    set: Set = [],
    store: StoreUrl = None,
    workers: Workers = None,
    limit: Limit = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only print the steps.")] = False,
) -> None:
    """Score the way from one setting to another, a field at a time: a table, a plot and JSON in the run's folder.

    Steps are in dataflow order, so that each re-runs as little as possible. With the defaults, the way leads through
    the discrete solver: the paper's optimiser gives way to it first, every other field is seen by the paper's
    objective, and the posterior method comes last, with the evidence for absence that it brings. Scores are of targets
    that every step has scored.
    """
    console = Console()
    console = console if console.is_terminal else Console(width=140)
    start, end, detours = _beside(run, origin), _beside(run, goal), [text for text in via if text]
    own = load_config(run, map(Carried, set))
    found = way(
        load_config(start),
        load_config(end),
        own.stages,
        [load_config(path, map(Carried, detours)) for path in (start, end)],
        [_field(text) for text in detours],
        [_field(text) for text in set],
    )
    if dry_run:
        for number, change in enumerate(found.steps, 1):
            console.print(f"{number:3} {change.step}", highlight=False, markup=False)
        return
    name = own.file.name
    series = [
        Member(m.label, (*m.overrides, *map(Carried, set))) for m in members(start.stem, found, f"{name}.ablation")
    ]
    refuse_unused(set, [load_config(run, member.overrides) for member in series])
    scored = run_series(console, run, series, store, workers, limit)
    console.print(series_table("ablation", scored))
    folder = run.parent / name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "ablation.html").write_text(series_plot(scored))
    (folder / "ablation.json").write_text(series_json(scored))
    console.print(f"plot and figures: {folder / 'ablation.html'}, ablation.json", highlight=False, markup=False)


def _beside(run: Path, name: str) -> Path:
    path = Path(name)
    return path if path.suffix == ".toml" else run.parent / f"{name}.toml"


def _field(override: str) -> str:
    return override.partition("=")[0].strip()
