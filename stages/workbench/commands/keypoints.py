"""`b23d keypoints`: a run's predictions as one table, in the coordinates of the shapes' own files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.run import Report, Run
from b23d.pipeline.verbs.options import Classes, RunPath, Set, Shapes, StoreUrl
from b23d.schemas.wording import counted
from b23d.stages.workbench.results.next_steps import next_steps, none_made

if TYPE_CHECKING:
    import pandas as pd

    from b23d.stages.workbench.results.keypoints import FoundKeypoints

SHOWN = 40
"""Rows that are printed where no file is asked for."""


def keypoints(
    run: RunPath,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help=".csv, .json, .parquet, or .ply (one shape). Default: print."),
    ] = None,
    shape: Shapes = [],
    category: Classes = [],
    draw: Annotated[list[int], typer.Option("--draw", help="Of these draws of shots; repeatable.")] = [],
    all_draws: Annotated[bool, typer.Option("--all-draws", help="Of every draw whose shots differ.")] = False,
    present: Annotated[bool, typer.Option("--present", help="Without those that are judged absent.")] = False,
    set: Set = [],
    store: StoreUrl = None,
) -> None:
    """One row a keypoint: class, shape, id, name, x y z in the file's own coordinates, nearest vertex, face and
    barycentrics, confidence (presuming that the shape is of its class), present, and of_class, the probability that it
    is."""
    from b23d.pipeline.inspection.artifact import passed_over
    from b23d.pipeline.inspection.unannotated import unannotated_notes
    from b23d.stages.workbench.commands.table_files import check_suffix, write_table
    from b23d.stages.workbench.results.keypoints import keypoint_table

    console = Console()
    if out is not None:
        check_suffix(out)
    loaded, chosen = Run.load(run, set, store), Selection(tuple(shape), tuple(category))
    draws = [seed for d in loaded.plan().draws for seed in [d.seed]] if all_draws else draw or None
    with console.status("reading") as status:
        found = keypoint_table(
            loaded,
            chosen,
            draws,
            lambda done, total: status.update(f"reading {done}/{total} shapes"),
        )
    table = found.table[found.table["present"]] if present else found.table
    if not len(found.table):
        raise ValueError(f"run {loaded.name}: expected predictions, got {none_made(loaded, chosen, found.waiting)}")
    if out is not None:
        out = passed_over(out, loaded)
        write_table(table, out)
        shapes = len(table[["class", "shape"]].drop_duplicates())
        said = f"wrote {out}: {counted(len(table), 'keypoint')} of {counted(shapes, 'shape')}"
        console.print(said, highlight=False, soft_wrap=True, markup=False)
    else:
        wide = console if console.is_terminal else Console(width=160)
        wide.print(_table(table.head(SHOWN)))
        if len(table) > SHOWN:
            wide.print(f"… and {counted(len(table) - SHOWN, 'more row')}; -o FILE.csv writes them all", highlight=False)
    for line in [*notes(found, draws is not None), *unannotated_notes(loaded, loaded.plan(chosen))]:
        console.print(f"[dim]{escape(line)}[/]", highlight=False, soft_wrap=True)


def notes(found: FoundKeypoints, asked: bool) -> list[str]:
    """Which draws these are, what is not there, and why."""
    lines = list(found.untold)
    for category, seeds in found.draws.items():
        others = [seed for seed in found.others.get(category, []) if not asked]
        if others:
            lines.append(f"{category}: draw {_listed(seeds)}; --all-draws adds {_listed(others)}")
    for category, seeds in found.alike.items():
        lines.append(f"{category}: draw {_listed(seeds)} left out: the same shots as a draw before, the same keypoints")
    if strangers := found.strangers():
        shown = ", ".join(strangers[:5]) + (f" and {len(strangers) - 5} more" if len(strangers) > 5 else "")
        lines.append(f"unlike the shots of their class, and perhaps of another (of_class below .5): {shown}")
    if found.waiting:
        lines.append(f"{counted(found.waiting, 'shape')} without a prediction yet: failed, or not run")
    return lines


def after_run(run: Run, report: Report, console: Console) -> None:
    """What to do with what a run has made, or about what it lacks."""
    for place, (command, gives) in enumerate(next_steps(run, report)):
        line = f"{'      ' if place else 'next: '}{command}   # {gives}"
        console.print(line, highlight=False, soft_wrap=True, markup=False)


def _table(rows: pd.DataFrame) -> Table:
    shown = Table(title_justify="left")
    for column in rows.columns:
        shown.add_column(str(column), justify="left" if rows[column].dtype.kind == "O" else "right")
    for row in rows.itertuples(index=False):
        shown.add_row(*(_cell(value) for value in row))
    return shown


def _cell(value: object) -> str:
    import pandas as pd

    if pd.isna(value):
        return "·"
    return f"{value:.5g}" if isinstance(value, float) else escape(str(value))


def _listed(seeds: list[int]) -> str:
    return ", ".join(map(str, seeds))
