"""An analysis as one self-contained HTML page."""

from __future__ import annotations

import json
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd

from b23d.schemas.wording import counted
from b23d.stages.workbench.analyses.interface import Chart, ExecutedMember, Pictures, Result
from b23d.stages.workbench.pictures.coloring import PLASMA
from b23d.stages.workbench.pictures.packing import as_json, data_uri, packed_plotly
from b23d.stages.workbench.pictures.painting import webp

HERE = Path(__file__).parent
STATIC = HERE.parent / "report" / "static"


def render_page(name: str, source: str, parts: list[ExecutedMember], result: Result, paper: str) -> str:
    """The page. `source`: the run file's name with its overrides; `paper`: what is quoted, or ""."""
    from jinja2 import Environment, FileSystemLoader
    from markupsafe import Markup

    run = parts[0].run
    encoder = getattr(run.config.params.get("extract"), "encoder", None)
    words = [
        run.config.dataset.kind,
        f"{counted(len(run.shapes), 'shape')}",
        encoder,
        f"{counted(len(parts), 'run')}" if len(parts) > 1 else None,
    ]
    charts = {str(i): _figure(block) for i, block in enumerate(result.blocks) if isinstance(block, Chart)}
    environment = Environment(
        loader=FileSystemLoader(HERE / "templates"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    kinds = result.table.dtypes
    columns = [{"name": column, "number": kinds[column].kind in "fiu"} for column in result.table.columns]
    return environment.get_template("analysis.html").render(
        name=name, line=" · ".join(word for word in words if word), result=result, paper=paper, source=source,
        columns=columns, rows=cells(result.table),
        blocks=[_block(str(i), block) for i, block in enumerate(result.blocks)], style=_static("report.css"),
        theme_script=_static("theme.js"), script=_static("library.js") + _static("figures.js"),
        data=Markup(as_json({"figures": charts})),
        plotly=Markup(packed_plotly()) if charts else "",
        plasma=", ".join(f"rgb({r}, {g}, {b})" for r, g, b in PLASMA), version=version("b23d"),
        made=time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime()),
    )  # fmt: skip


def cells(table: pd.DataFrame) -> list[list[str]]:
    """A table's rows as people read them: columns of whole numbers as such, others with three decimals."""
    return [list(row) for row in zip(*(_column(table[name]) for name in table.columns), strict=True)]


def _column(values: pd.Series) -> list[str]:
    if values.dtype.kind != "f":
        return [str(value) for value in values]
    there = values.dropna()
    whole = bool((there == there.round()).all()) and bool((there.abs() > 1).any())  # a similarity of 1 keeps its digits
    return ["–" if pd.isna(value) else f"{value:.0f}" if whole else f"{value:.3f}" for value in values]


def _static(name: str) -> Any:
    from markupsafe import Markup

    return Markup((STATIC / name).read_text())


def _figure(block: Chart) -> Any:
    return json.loads(str(block.figure.to_json()))


def _block(key: str, block: Chart | Pictures) -> dict[str, Any]:
    if isinstance(block, Chart):
        return {"chart": key, "caption": block.caption, "height": block.figure.layout.height or 430}
    lines = [
        {
            "label": label,
            "pictures": [{"label": under, "image": data_uri(webp(image), "image/webp")} for under, image in pictures],
        }
        for label, pictures in block.lines
    ]
    return {"title": block.title, "lines": lines, "caption": block.caption, "scale": block.scale}
