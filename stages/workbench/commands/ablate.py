"""`b23d ablate`: from one setting of the stages to another, one field at a time, each step scored; all that is
unchanged is re-used.

A field can take a detour: first to a value of its own, and to the goal's last, so that all others are seen there. The
paper's objective is such a place: the published optimiser is too slow to be run at every step, and the posterior method
ignores half of the fields.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from b23d.pipeline.config import Config, load_config
from b23d.pipeline.members import Member
from b23d.stages.workbench.commands.series import run_series, series_json, series_plot, series_table

DETOURS = ["stages.optimize.method=discrete", "stages.optimize.presence=all"]
"""By the paper's own objective, solved fast; and absence only once there is evidence of it."""


@dataclass(frozen=True)
class Change:
    """One step: one field."""

    field: str
    old: Any
    new: Any

    def __str__(self) -> str:
        return f"{self.field.removeprefix('stages.')}: {_plain(self.old)} → {_plain(self.new)}"


def changes(
    origin: Config, goal: Config, stages: Iterable[str], detours: Config, via: Sequence[str], fixed: Sequence[str]
) -> list[Change]:
    """The steps from `origin` to `goal`: detours' first halves, then field by field in dataflow order, then detours'
    second halves.

    stages: in dataflow order; others stay. detours: `origin` with the values of the fields `via`, of which only those
    that differ between origin and goal are taken. fixed: fields that stay whatever the two say.
    """
    differ: dict[str, tuple[Any, Any]] = {}
    for stage in stages:
        if stage in origin.params and stage in goal.params:
            old, new = origin.params[stage].hashed(), goal.params[stage].hashed()
            differ |= {f"stages.{stage}.{key}": (old[key], new[key]) for key in old if old[key] != new[key]}
    differ = {
        field: pair for field, pair in differ.items() if not any(field == f or f.startswith(f"{field}.") for f in fixed)
    }
    middle = {field: _at(detours, field) for field in via if field in differ}
    out = [Change(field, differ[field][0], value) for field, value in middle.items()]
    straight = [Change(field, old, new) for field, (old, new) in differ.items() if field not in middle]
    back = [Change(field, value, differ[field][1]) for field, value in middle.items()]
    return [change for change in (*out, *straight, *back) if change.old != change.new]


def members(origin: str, steps: Sequence[Change], name: str) -> list[Member]:
    """The run before the first step, and that after each."""
    state: dict[str, Any] = {}
    for change in steps:
        state.setdefault(change.field, change.old)
    found = [Member(origin, _overrides(state, name))]
    for change in steps:
        state[change.field] = change.new
        found.append(Member(str(change), _overrides(state, name)))
    return found


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
    set: Annotated[
        list[str], typer.Option("--set", metavar="a.b=value", help="Fixed throughout: no step changes it.")
    ] = [],
    store: Annotated[str | None, typer.Option("--store", metavar="PATH|URL")] = None,
    workers: Annotated[int | None, typer.Option(min=0)] = None,
    limit: Annotated[
        int | None, typer.Option("--limit", min=1, help="Only each class's first N shapes as targets.")
    ] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only print the steps.")] = False,
) -> None:
    """Score the way from one setting to another, a field at a time: a table, a plot and JSON in the run's folder.

    Steps are in dataflow order, so that each re-runs as little as possible. With the defaults, the way leads through
    the discrete solver: the paper's optimiser gives way to it first, every other field is seen by the paper's
    objective, and the posterior method, which ignores some of them, comes last, with the evidence for absence that it
    brings. Scores are of targets that every step has scored.
    """
    console = Console()
    console = console if console.is_terminal else Console(width=140)
    start, detours = _beside(run, origin), [text for text in via if text]
    fixed = [text.partition("=")[0].strip() for text in set]
    steps = changes(
        load_config(start),
        load_config(_beside(run, goal)),
        load_config(run, set).stages,
        load_config(start, detours),
        [text.partition("=")[0].strip() for text in detours],
        fixed,
    )
    if dry_run:
        for number, change in enumerate(steps, 1):
            console.print(f"{number:3} {change}", highlight=False, markup=False)
        return
    name = load_config(run, set).file.name
    series = [Member(m.label, (*m.overrides, *set)) for m in members(start.stem, steps, f"{name}.ablation")]
    found = run_series(console, run, series, store, workers, limit)
    console.print(series_table("ablation", found))
    folder = run.parent / name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "ablation.html").write_text(series_plot(found))
    (folder / "ablation.json").write_text(series_json(found))
    console.print(f"plot and figures: {folder / 'ablation.html'}, ablation.json", highlight=False)


def _overrides(state: dict[str, Any], name: str) -> tuple[str, ...]:
    return (*(f"{field}={json.dumps(value)}" for field, value in state.items()), f"name={name}")


def _at(config: Config, field: str) -> Any:
    _, stage, key = field.split(".", 2)
    return config.params[stage].hashed()[key]


def _plain(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)


def _beside(run: Path, name: str) -> Path:
    path = Path(name)
    return path if path.suffix == ".toml" else run.parent / f"{name}.toml"
