"""A comparison as one self-contained HTML page: for every group of systems the paper's kind of figure and table, its
words beside."""

from __future__ import annotations

import json
import time
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from b23d.pipeline.runfile.config import Config
from b23d.schemas.scores import ClassScores, PartTable, Spread
from b23d.schemas.wording import averaged, counted
from b23d.stages.scoring.quoted import (
    B2_3D,
    CURVES,
    PART_CLASSES,
    PARTS,
    STATEMENTS,
    QuotedCurve,
    QuotedParts,
    statements_of,
)
from b23d.stages.workbench.pictures.figures import MEAN, add_curve, add_quoted, curve_layout
from b23d.stages.workbench.pictures.packing import as_json, packed_plotly
from b23d.stages.workbench.pictures.palette import COLORS, class_color
from b23d.stages.workbench.report.page import AT, environment, few
from b23d.stages.workbench.results.comparing import Comparison, System

if TYPE_CHECKING:
    import plotly.graph_objects as go

HERE = Path(__file__).parent
DASHES = ("solid", "dot", "dashdot")
PAGE = "comparison.html"
SHOWN = (0.02, 0.05, 0.10)
COLUMNS = ("IoU .02", "IoU .05", "IoU .10", "AUC", "PCK .10", "sym. PCK .10", "s / shape")


def write_comparison(config: Config, comparison: Comparison, folder: Path) -> Path:
    """Write `comparison.html` and `comparison.json` into a folder; returns the page."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "comparison.json").write_text(comparison.as_json(), encoding="utf-8")
    (folder / PAGE).write_text(render_comparison(config, comparison), encoding="utf-8")
    return folder / PAGE


def render_comparison(config: Config, comparison: Comparison) -> str:
    """The page."""
    from markupsafe import Markup

    groups = [_group(name, systems) for name, systems in comparison.groups().items()]
    data = {"figures": {group["key"]: group["figure"] for group in groups if group["figure"] is not None}}
    shots, shown = config.file.shots, [system for system in comparison.systems if system.shown]
    said = {line for system in comparison.systems for line in statements_of(system.name)}
    return environment().get_template("comparison.html").render(
        name=config.file.name, groups=groups, source=B2_3D.source, protocol=_protocol(shown),
        over=averaged(_draws(shown)), counted=counted, comparison=comparison,
        line=f"{config.dataset.kind} · {few(shots)} · {len(shown)} of {counted(len(comparison.systems), 'system')}",
        unsaid=[statement for statement in STATEMENTS if statement not in said], systems=comparison.systems,
        style=Markup(_static("report.css")), theme_script=Markup(_static("theme.js")),
        script=Markup(_static("library.js") + _static("figures.js")),
        plotly=Markup(packed_plotly()) if data["figures"] else "", data=Markup(as_json(data)), version=version("b23d"),
        made=time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime()), file=config.path.name,
        overrides="".join(f", --set {text}" for text in config.overrides),
    )  # fmt: skip


def comparison_curves(systems: list[System], quoted: tuple[QuotedCurve, ...] = CURVES) -> go.Figure:
    """IoU over threshold, mean over classes: a curve with its sd band a system, references in front, the paper's
    printed ones dashed."""
    import plotly.graph_objects as go

    figure = go.Figure()
    scored = [system for system in systems if system.scores is not None]
    references = [system for system in scored if not system.group]
    for place, system in enumerate(s for s in scored if s.group):
        _curve(figure, system, class_color(place), DASHES[place // COLORS % len(DASHES)])
    for place, system in enumerate(references):  # last, so that they lie on top
        _curve(figure, system, MEAN if len(references) == 1 else class_color(place), "solid", wide=len(references) == 1)
    add_quoted(figure, quoted)
    largest = max((max(s.scores.mean.thresholds) for s in scored if s.scores is not None), default=0.1)
    return figure.update_layout(curve_layout(largest))


def keypoint_lines(systems: list[System]) -> list[dict[str, Any]]:
    """The table of a group: a line a system, then the paper's printed rows, marked as quoted."""
    lines = [_keypoint_line(system) for system in systems]
    for curve in _quoted(systems):
        iou = [ratio(curve.iou[place], 2) for place in AT]
        cells = [*iou, ratio(curve.auc), "", "", ""]
        lines.append({"name": f"{curve.system} (paper)", "cells": cells, "quoted": True, "says": [curve.setting]})
    return lines


def part_lines(systems: list[System]) -> dict[str, Any]:
    """Part transfer: classes as columns, a line a system in percent, then the paper's rows, marked as quoted."""
    tables = [system.parts for system in systems if system.parts is not None]
    classes = sorted({name for table in tables for name in table.classes}) or list(PART_CLASSES)
    lines: list[dict[str, Any]] = [
        {
            "name": system.name, "note": system.note, "reason": system.reason, "says": [],
            "seconds": brief(system.seconds),
            "cells": [] if system.parts is None else _part_cells(system.parts, classes),
        }
        for system in systems
    ]  # fmt: skip
    for row in PARTS:
        cells = [*(_part(row, name) for name in classes), f"{row.mean:.1f}"]
        lines.append({"name": f"{row.system} (paper)", "cells": cells, "quoted": True, "seconds": ""})
    return {"classes": classes, "lines": lines}


def ratio(value: float, digits: int = 3) -> str:
    """ ".712", without its 0."""
    text = f"{value:.{digits}f}"
    return text[1:] if text.startswith("0.") else text


def brief(seconds: float | None) -> str:
    """Seconds with three digits, or nothing."""
    return "" if seconds is None else f"{seconds:.3g}" if seconds < 100 else f"{seconds:,.0f}"


def _group(name: str, systems: list[System]) -> dict[str, Any]:
    about_parts = any(system.kind == "parts" for system in systems)
    scored = any(system.scores is not None for system in systems)
    drawn = json.loads(str(comparison_curves(systems, _quoted(systems)).to_json())) if scored else None
    return {
        "key": "".join(c if c.isalnum() else "-" for c in name), "name": name[:1].upper() + name[1:], "figure": drawn,
        "parts": part_lines(systems) if about_parts else None, "lines": [] if about_parts else keypoint_lines(systems),
        "classes": _by_class(systems), "columns": COLUMNS,
    }  # fmt: skip


def _curve(figure: go.Figure, system: System, color: str, dash: str, wide: bool = False) -> None:
    if system.scores is not None:
        add_curve(figure, system.name, system.scores.mean, color, wide, dash)


def _quoted(systems: list[System]) -> tuple[QuotedCurve, ...]:
    """The method's own printed curve, and those of systems of this group."""
    names = {system.name.casefold() for system in systems}
    return tuple(curve for curve in CURVES if curve is B2_3D or curve.system.casefold() in names)


def _keypoint_line(system: System) -> dict[str, Any]:
    line: dict[str, Any] = {
        "name": system.name, "reason": system.reason, "note": system.note, "cells": [], "reference": not system.group,
        "says": [statement.says for statement in statements_of(system.name)],
    }  # fmt: skip
    if system.scores is not None:
        mean = system.scores.mean
        iou = [ratio(_at(mean, threshold), 2) for threshold in SHOWN]
        nameless = mean.presence.recall.mean == 0  # a detector's keypoints have no ids
        pck = ["–" if nameless else ratio(curve.mean[-1], 2) for curve in (mean.pck, mean.symmetric_pck)]
        line["cells"] = [*iou, _spread(mean.auc, mean.draws), *pck, brief(system.seconds)]
    return line


def _by_class(systems: list[System]) -> dict[str, Any] | None:
    """AUC by class, where there are several."""
    tables = [(system.name, system.scores) for system in systems if system.scores is not None]
    classes = sorted({name for _, table in tables for name in table.classes})
    if len(classes) < 2:
        return None
    rows = []
    for name, table in tables:
        cells = [_spread(table.classes[c].auc, table.classes[c].draws) if c in table.classes else "–" for c in classes]
        rows.append({"name": name, "cells": cells})
    return {"classes": classes, "rows": rows}


def _part_cells(table: PartTable, classes: list[str]) -> list[str]:
    draws = max(one.draws for one in table.classes.values())
    each = [_percent(table.classes[c].iou, table.classes[c].draws) if c in table.classes else "–" for c in classes]
    return [*each, _percent(table.mean, draws)]


def _part(row: QuotedParts, category: str) -> str:
    found = row.of(category)
    return "–" if found is None else f"{found:.1f}"


def _percent(spread: Spread, draws: int) -> str:
    return f"{100 * spread.mean:.1f}" + (f" ± {100 * spread.sd:.1f}" if draws > 1 else "")


def _spread(spread: Spread, draws: int) -> str:
    return ratio(spread.mean) + (f" ± {ratio(spread.sd)}" if draws > 1 else "")


def _at(scores: ClassScores, threshold: float) -> float:
    return min(zip(scores.thresholds, scores.iou.mean, strict=True), key=lambda pair: abs(pair[0] - threshold))[1]


def _protocol(systems: list[System]) -> str:
    return " | ".join(
        sorted({table.protocol for system in systems if (table := system.scores or system.parts) is not None})
    )


def _draws(systems: list[System]) -> int:
    """The most draws that a system's figures are over."""
    tables = [system.scores.mean.draws for system in systems if system.scores is not None]
    parts = [one.draws for s in systems if s.parts is not None for one in s.parts.classes.values()]
    return max([1, *tables, *parts])


def _static(name: str) -> str:
    return (HERE / "static" / name).read_text()
