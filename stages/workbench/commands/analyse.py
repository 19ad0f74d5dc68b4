"""`b23d analyse`: what a run file's `[analysis]` table asks for, over the values of its sweep or its variants.

[analysis]
kind = "stability"
reference = 7

[sweep]
"stages.render.rings" = [1, 3, 5, 7]
"""

from __future__ import annotations

import json
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated

import typer
from pydantic import ValidationError
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.config import Config, load_config
from b23d.pipeline.errors import RunFileError
from b23d.pipeline.members import Member, members
from b23d.pipeline.run import Run

if TYPE_CHECKING:
    from b23d.stages.workbench.analyses.interface import AnalysisParams, Part, Result


def analyse(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run file with an [analysis] table.")],
    set: Annotated[
        list[str], typer.Option("--set", metavar="a.b=value", help="Override anything the run file says; repeatable.")
    ] = [],
    store: Annotated[str | None, typer.Option("--store", metavar="PATH|URL")] = None,
    workers: Annotated[int | None, typer.Option(min=0, help="Worker processes; 0: run in this process.")] = None,
) -> None:
    """Stability, similarity, semantics, principal components: a table, and a page with figures in the run's folder."""
    from b23d.stages.workbench.analyses.page import render_page

    console = Console()
    config = load_config(run, set)
    module, params = analysis_of(config)
    parts = executed(console, config, module.needs(params), store, workers)
    with console.status("comparing"):
        result = module.analyse(parts, params)
        page = run.parent / config.file.name / "analysis.html"
        page.parent.mkdir(parents=True, exist_ok=True)
        source = run.name + "".join(f", --set {text}" for text in set)
        page.write_text(render_page(config.file.name, source, parts, result, params.paper), encoding="utf-8")
        result.table.to_csv(page.with_suffix(".csv"), index=False)
    (console if console.is_terminal else Console(width=140)).print(_table(result))
    if params.paper:
        console.print(f"paper: {escape(params.paper)}", style="dim", highlight=False)
    console.print(f"figures: {page}; table: {page.with_suffix('.csv')}", highlight=False, soft_wrap=True)


def analysis_of(config: Config) -> tuple[ModuleType, AnalysisParams]:
    """The analysis that a run file asks for, and its checked fields. Raises RunFileError."""
    from b23d.stages.workbench.analyses import module_of

    table = config.file.analysis
    try:
        module = module_of(table)
        params: AnalysisParams = module.Parameters.model_validate(table)
    except ValidationError as error:
        lines = [
            f"run file {config.path}: [analysis] {'.'.join(map(str, e['loc']))}: {e['msg'].lower()}; mend it"
            for e in error.errors()
        ]
        raise RunFileError("\n".join(lines)) from error
    except ValueError as error:
        raise RunFileError(f"run file {config.path}: {error}") from error
    return module, params


def executed(
    console: Console, config: Config, outputs: list[str], store: str | None, workers: int | None
) -> list[Part]:
    """The run's members, or the run itself where it has none, with these outputs; only what is missing is made."""
    from b23d.stages.workbench.analyses.interface import Part

    parts = []
    for member in members(config) or [Member(config.file.name, config.overrides)]:
        loaded = Run.load(config.path, (*member.overrides, f"outputs={json.dumps(outputs)}"), store)
        with console.status(f"{member.label}: running"):
            report = loaded.execute(workers)
        stages = {outcome.stage for outcome in report.done}
        ran = ", ".join(name for name in loaded.config.stages if name in stages) or "nothing"
        console.print(f"[dim]{escape(member.label)}: ran {ran} in {report.seconds:.0f} s[/]", highlight=False)
        for failure in report.failures:
            console.print(
                f"  [red]✗[/] {failure.stage}: {escape(failure.error)}; left out", highlight=False, soft_wrap=True
            )
        parts.append(Part(member.label, member.series, loaded))
    return parts


def _table(result: Result) -> Table:
    from b23d.stages.workbench.analyses.page import cells

    table = Table(title=result.title, title_justify="left")
    for column in result.table.columns:
        number = result.table[column].dtype.kind in "fiu"
        table.add_column(str(column), justify="right" if number else "left", overflow="fold")
    for row in cells(result.table):
        table.add_row(*map(escape, row))
    return table
