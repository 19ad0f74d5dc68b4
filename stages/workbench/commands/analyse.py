"""`b23d analyse`: what a run file's `[analysis]` table asks for, over the values of its sweep or its variants.

[analysis]
kind = "stability"
reference = 7

[sweep]
"stages.render.rings.count" = [1, 3, 5, 7]
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape

from b23d.pipeline.runfile.config import load_config
from b23d.pipeline.runfile.overrides import Carried
from b23d.pipeline.verbs.options import Set, StoreUrl, Workers


def analyse(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run file with an [analysis] table.")],
    set: Set = [],
    store: StoreUrl = None,
    workers: Workers = None,
) -> None:
    """Stability, similarity, semantics, principal components: a table, and a page with figures in the run's folder."""
    from b23d.stages.workbench.analyses.page import render_page
    from b23d.stages.workbench.analyses.running import analysis_of, executed, result_table

    console = Console()
    config = load_config(run, map(Carried, set))
    module, params = analysis_of(config)
    parts = executed(console, config, module.needs(params), store, workers)
    with console.status("comparing"):
        result = module.analyse(parts, params)
        page = run.parent / config.file.name / "analysis.html"
        page.parent.mkdir(parents=True, exist_ok=True)
        source = run.name + "".join(f", --set {text}" for text in set)
        page.write_text(render_page(config.file.name, source, parts, result, params.paper), encoding="utf-8")
        result.table.to_csv(page.with_suffix(".csv"), index=False)
    (console if console.is_terminal else Console(width=140)).print(result_table(result))
    if params.paper:
        console.print(f"paper: {escape(params.paper)}", style="dim", highlight=False)
    console.print(f"figures: {page}; table: {page.with_suffix('.csv')}", highlight=False, markup=False, soft_wrap=True)
