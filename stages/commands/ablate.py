"""`b23d ablate`: from one setting of the stages to another, one field at a time, each step scored; all that is unchanged is re-used."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from pipeline.config import load_config
from stages.commands.series import Member, run_series, series_plot, series_table


def steps(origin: Path, goal: Path, run: Path) -> list[Member]:
    """The steps from the stages' params of one run file to those of another, in dataflow order of `run`.

    The first member is the origin; each further one changes one field for good. Fields that the shots and the data set have
    are the run's own and stay.
    """
    before, after = load_config(origin), load_config(goal)
    order = [name for name in load_config(run).stages if name in before.params and name in after.params]
    changes: list[tuple[str, Any, Any]] = []
    for stage in order:
        old, new = before.params[stage].hashed(), after.params[stage].hashed()
        changes += [(f"stages.{stage}.{key}", old[key], new[key]) for key in old if old[key] != new[key]]
    members = []
    for count in range(len(changes) + 1):
        values = [(field, new if i < count else old) for i, (field, old, new) in enumerate(changes)]
        label = origin.stem
        if count:
            field, old, new = changes[count - 1]
            label = f"{field}: {json.dumps(old)} → {json.dumps(new)}"
        overrides = [f"{name}={json.dumps(value)}" for name, value in values]
        members.append(Member(label, (*overrides, f"name={load_config(run).file.name}.ablation")))
    return members


def ablate(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run file: its data set and shots are used.")],
    origin: Annotated[str, typer.Option("--from", help="Run file, or the name of one beside RUN.")] = "released",
    goal: Annotated[str, typer.Option("--to", help="Run file, or the name of one beside RUN.")] = "corrected",
    set: Annotated[list[str], typer.Option("--set", metavar="a.b=value", help="Fixed throughout.")] = [],  # noqa: B006
    store: Annotated[str | None, typer.Option("--store", metavar="PATH|URL")] = None,
    workers: Annotated[int | None, typer.Option(min=0)] = None,
    limit: Annotated[int | None, typer.Option("--limit", min=1)] = None,
) -> None:
    """Score the way from one run file to another, a field at a time: a table, and a plot in the run's folder."""
    console = Console()
    members = [Member(m.label, (*m.overrides, *set)) for m in steps(_beside(run, origin), _beside(run, goal), run)]
    found = run_series(console, run, members, store, workers, limit)
    console.print(series_table("ablation", found))
    path = run.parent / load_config(run, set).file.name / "ablation.html"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(series_plot(found))
    console.print(f"plot: {path}", highlight=False)


def _beside(run: Path, name: str) -> Path:
    path = Path(name)
    return path if path.suffix == ".toml" else run.parent / f"{name}.toml"
