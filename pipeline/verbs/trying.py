"""`b23d try`: one task alone, in this process."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.verbs.options import DrawOption, RunPath, Set, StoreUrl
from b23d.pipeline.verbs.terminal import console

PROFILED = 25  # functions that --profile prints


def try_(
    run: RunPath,
    shape: Annotated[str, typer.Argument(help="Name of the shape: <class>/<id>.")],
    stage: Annotated[str, typer.Argument(help="Stage to run.")],
    set: Set = [],
    store: StoreUrl = None,
    draw: DrawOption = None,
    pdb: Annotated[bool, typer.Option("--pdb", help="Stop at the stage's first line, and where it raises.")] = False,
    profile: Annotated[bool, typer.Option("--profile", help="Print where the time goes.")] = False,
) -> None:
    """Run one stage of one shape here, on stored inputs. Stores nothing; compares with what is stored."""
    from b23d.pipeline.inspection.artifact import value_range
    from b23d.pipeline.inspection.trying import attempt
    from b23d.pipeline.run import Run

    loaded = Run.load(run, set, store)
    trial = attempt(loaded, shape, stage, draw, _debugged if pdb else _profiled if profile else None)
    if trial.made:
        console.print(f"[dim]not stored, so made here first: {escape(', '.join(trial.made))}[/]", highlight=False)
    title = escape(f"{trial.stage} of {trial.shape}: {trial.seconds:.3f} s, not stored")
    table = Table("array", "shape", "dtype", "range", "unit", title=title, title_justify="left")
    specs = trial.artifact.array_specs()
    for name, array in trial.artifact.present_arrays().items():
        dims = " × ".join(map(str, array.shape))
        table.add_row(name, dims, array.dtype.name, value_range(array), escape(specs[name].unit))
    console.print(table)
    if not trial.stored:
        console.print(f"nothing is stored at {trial.address[:12]} to compare with", highlight=False)
    elif trial.differences:
        console.print(f"differs from what is stored at {trial.address[:12]}, first in:", highlight=False)
        for difference in trial.differences:
            console.print(f"  {escape(str(difference))}", highlight=False, soft_wrap=True)
    else:
        console.print(f"the same as what is stored at {trial.address[:12]}", highlight=False)


def _debugged(function: Any, **arguments: Any) -> Any:
    import pdb
    import sys

    debugger = pdb.Pdb()
    try:
        return debugger.runcall(function, **arguments)
    except Exception:
        pdb.post_mortem(sys.exc_info()[2])
        raise


def _profiled(function: Any, **arguments: Any) -> Any:
    import cProfile
    import pstats

    profiler = cProfile.Profile()
    try:
        return profiler.runcall(function, **arguments)
    finally:
        pstats.Stats(profiler, stream=console.file).sort_stats("cumulative").print_stats(PROFILED)
