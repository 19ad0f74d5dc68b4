"""From a run file with an `[analysis]` table to what its analysis compares: executed runs."""

from __future__ import annotations

import json
from types import ModuleType

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.errors import RunFileError
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.checking import Where, validate
from b23d.pipeline.runfile.config import Config, load_config, refuse_unused
from b23d.pipeline.runfile.members import Member, members
from b23d.stages.workbench.analyses import module_of
from b23d.stages.workbench.analyses.interface import AnalysisParams, ExecutedMember, Result
from b23d.stages.workbench.analyses.page import cells


def analysis_of(config: Config) -> tuple[ModuleType, AnalysisParams]:
    """The analysis that a run file asks for, and its checked fields. Raises RunFileError."""
    table, place = config.file.analysis, Where(config.path, "analysis", config.overrides)
    try:
        module = module_of(table)
    except ValueError as error:
        raise RunFileError(f"{place.of('kind')}: {error}") from error
    params: AnalysisParams = validate(module.Parameters, table, place)
    return module, params


def executed(
    console: Console, config: Config, outputs: list[str], store: str | None, workers: int | None
) -> list[ExecutedMember]:
    """The run's members, or the run itself where it has none, with these outputs; only what is missing is made."""
    parts, listed = [], members(config) or [Member(config.file.name, config.overrides)]
    if config.overrides:
        refuse_unused(config.overrides, [load_config(config.path, member.overrides) for member in listed])
    for member in listed:
        loaded = Run.load(config.path, (*member.overrides, f"outputs={json.dumps(outputs)}"), store)
        with console.status(f"{escape(member.label)}: running"):
            report = loaded.execute(workers)
        stages = {outcome.stage for outcome in report.done}
        ran = ", ".join(name for name in loaded.config.stages if name in stages) or "nothing"
        console.print(f"[dim]{escape(member.label)}: ran {ran} in {report.seconds:.0f} s[/]", highlight=False)
        for failure in report.failures:
            console.print(
                f"  [red]✗[/] {failure.stage}: {escape(failure.error)}; left out", highlight=False, soft_wrap=True
            )
        parts.append(ExecutedMember(member.label, member.series, loaded))
    return parts


def result_table(result: Result) -> Table:
    table = Table(title=escape(result.title), title_justify="left")
    for column in result.table.columns:
        number = result.table[column].dtype.kind in "fiu"
        table.add_column(escape(str(column)), justify="right" if number else "left", overflow="fold")
    for row in cells(result.table):
        table.add_row(*map(escape, row))
    return table
