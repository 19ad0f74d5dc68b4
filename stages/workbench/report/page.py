"""The page itself: templates filled with what was gathered, styles, scripts and libraries put inside."""

from __future__ import annotations

import json
import time
from collections import Counter
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from b23d.pipeline.inspection.unannotated import unannotated_notes
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.records.warned import warnings
from b23d.pipeline.run import Run
from b23d.schemas.runfile import Shots
from b23d.schemas.scores import ClassScores, ScoreTable
from b23d.schemas.wording import averaged, counted
from b23d.stages.datasets.names import keypoint_names
from b23d.stages.scoring.quoted import B2_3D, CURVES
from b23d.stages.scoring.reliability import reliability
from b23d.stages.workbench.pictures.packing import as_json, packed_plotly
from b23d.stages.workbench.pictures.palette import IDS, class_color, id_color
from b23d.stages.workbench.results.columns import STRANGE, mean, shown_columns
from b23d.stages.workbench.results.gathering import Quarantined
from b23d.stages.workbench.results.summary import costs, dataset_fields, origins, settings
from b23d.stages.workbench.results.untold import Known, untold

if TYPE_CHECKING:
    from jinja2 import Environment

HERE = Path(__file__).parent
SCRIPTS = (  # in this order
    "library", "details", "fields", "scene", "balls", "panel", "viewer", "curves", "table", "main",
)  # fmt: skip
AT = (2, 5, 10)  # places of thresholds .02, .05, .10


def render_page(
    run: Run,
    plan: Plan,
    rows: list[dict[str, Any]],
    table: ScoreTable | None,
    examples: list[dict[str, Any]],
    failures: list[Quarantined],
    folder: str,
    inline: dict[str, str],
    draw: int | None,
    analysis: str | None = None,
) -> str:
    """The whole page. `folder`: where details lie, relative to the page; `inline`: key → script that brings them, to
    stand inside; `analysis`: the page of `b23d analyse`, relative to this one."""
    stage_costs = costs(run, plan)
    fields = settings(run)
    columns = shown_columns(rows)
    judged = [pair for row in rows for pair in row.pop("judged", [])]
    data = {
        "rows": rows,
        "columns": [{"key": c.key, "shown": c.shown, "bar": c.bar} for c in columns],
        "names": keypoint_names(run.shapes),
        "folder": folder,
        "draw": draw,
        "idColors": [id_color(i) for i in range(IDS)],
        "curves": json.loads(_curves(table)) if table is not None else None,
    }
    safe = _markup()
    return (
        environment()
        .get_template("report.html")
        .render(
            run=_run(run, rows),
            analysis=analysis,
            cards=cards(rows, table, stage_costs),
            table=score_lines(table) if table else None,
            paper_source=B2_3D.source,
            reliability=reliability_lines(judged),
            untold=untold(run, _told(rows)),
            examples=examples,
            classes=sorted({row["category"] for row in rows}),
            failures=failures,
            warnings=[*unannotated_notes(run, plan), *warnings(run.folder, plan)],
            columns=columns,
            costs=cost_lines(stage_costs),
            settings=fields,
            changed=[line for line in fields if line["differs"]],
            dataset=dataset_fields(run),
            origins=origins(run, plan),
            draws=_draws(plan),
            style=safe(_static("report.css")),
            theme_script=safe(_static("theme.js")),
            scripts=[safe(_static(f"{name}.js")) for name in SCRIPTS],
            plotly=safe(packed_plotly()),
            data=safe(as_json(data)),
            inline_details=[(key, safe(text)) for key, text in inline.items()],
        )
    )


def environment() -> Environment:
    """The templates, which escape all text."""
    from jinja2 import Environment, FileSystemLoader

    return Environment(
        loader=FileSystemLoader(HERE / "templates"), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )


def cards(
    rows: list[dict[str, Any]], table: ScoreTable | None, stage_costs: list[dict[str, Any]]
) -> list[dict[str, str]]:
    """The figures at the top of the page."""
    found = []
    if table is not None:
        scores = table.mean
        note = "mean over classes" if len(table.classes) > 1 else next(iter(table.classes))
        found.append({"label": "AUC 0 … .10", "value": _figure(scores.auc.mean), "note": _spread(scores)})
        for place in AT[1:]:
            if place < len(scores.iou.mean):
                found.append(
                    {
                        "label": f"IoU {_threshold(scores, place)}",
                        "value": _figure(scores.iou.mean[place], 2),
                        "note": note,
                    }
                )
        found.append(
            {"label": f"labelled PCK {_threshold(scores, -1)}", "value": _figure(scores.pck.mean[-1], 2), "note": note}
        )
        found.append(
            {
                "label": "ceiling of IoU",
                "value": _figure(scores.ceiling, 2),
                "note": "perfect, labelled, from these shots",
            }
        )
    sure = mean(row["confidence"] for row in rows)
    if sure is not None:
        found.append(
            {"label": "confidence", "value": _figure(sure, 2), "note": "mean over shapes, presuming their class"}
        )
    strange = sum(row["of_class"] is not None and row["of_class"] < STRANGE for row in rows)
    if strange:
        note = "of class below .5: sort the shapes by it"
        found.append({"label": "unlike their class", "value": counted(strange, "shape"), "note": note})
    states = Counter(row["state"] for row in rows)
    told = [f"{states[state]} {state}" for state in ("failed", "waiting", "unpredicted") if states[state]]
    found.append({"label": "shapes", "value": f"{len(rows):,}", "note": ", ".join(told) or "all done"})
    seconds, stored = sum(cost["seconds"] for cost in stage_costs), sum(cost["bytes"] for cost in stage_costs)
    found.append({"label": "computed in", "value": duration(seconds), "note": "all workers together"})
    size = f"{stored / 1e6:,.0f} MB" if stored < 1e10 else f"{stored / 1e9:,.1f} GB"
    found.append(
        {"label": "stored", "value": size, "note": counted(sum(cost["made"] for cost in stage_costs), "artifact")}
    )
    return found


def score_lines(table: ScoreTable) -> dict[str, Any]:
    """The class table: a line a class, their mean, the paper's."""
    places = [place for place in AT if place < len(table.mean.thresholds)] or [len(table.mean.thresholds) - 1]
    lines = [
        _score_line(name, scores, places, class_color(i)) for i, (name, scores) in enumerate(table.classes.items())
    ]
    if len(lines) > 1:
        lines.append({**_score_line("mean of classes", table.mean, places, ""), "mean": True})
    for curve in CURVES:
        iou = [_figure(curve.iou[place], 2) for place in places]
        lines.append({"name": f"{curve.system}, paper", "auc": _figure(curve.auc), "iou": iou, "quoted": True})
    at = [_threshold(table.mean, place) for place in places]
    return {"lines": lines, "over": averaged(table.mean.draws), "at": at, "protocol": table.protocol}


def reliability_lines(judged: list[tuple[float, bool]]) -> dict[str, Any] | None:
    """The reliability diagram: per bin of confidence what was said, what share was right, and of how many."""
    found = reliability(np.array([sure for sure, _ in judged]), np.array([right for _, right in judged], bool))
    if found is None:
        return None
    most = found.counts.max()
    bins = [
        {"said": f"{said:.2f}", "true": f"{true:.2f}", "count": f"{count:,}"}
        | {
            "x": round(200 * said, 1),
            "y": round(200 * (1 - true), 1),
            "r": round(2 + 6 * float(count / most) ** 0.5, 1),
        }
        for count, said, true in zip(found.counts, found.said, found.true, strict=True)
    ]
    return {"bins": bins, "error": _figure(found.error), "count": f"{len(judged):,}"}


def cost_lines(stage_costs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Costs as texts, with the share of the largest for the bars."""
    slowest = max((cost["seconds"] for cost in stage_costs), default=0) or 1
    largest = max((cost["bytes"] for cost in stage_costs), default=0) or 1
    return [
        {
            **cost,
            "share": round(100 * cost["seconds"] / slowest, 1),
            "stored_share": round(100 * cost["bytes"] / largest, 1),
            "total": f"{cost['seconds']:,.1f}",
            **{key: f"{cost[key]:.3f}" for key in ("median", "p95", "slowest")},
            "peak": f"{cost['peak_mb']:,.0f}",
            "stored": f"{cost['bytes'] / 1e6:,.1f}",
            "each": f"{cost['bytes_each'] / 1e6:.2f}",
        }
        for cost in stage_costs
    ]


def few(shots: Shots) -> str:
    """3 shots, 5 draws."""
    return f"{counted(shots.count, 'shot')}, {counted(len(shots.draws), 'draw')}"


def duration(seconds: float) -> str:
    """12 s, 3 min 20 s, 4 h 5 min."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


def _score_line(name: str, scores: ClassScores, places: list[int], color: str) -> dict[str, Any]:
    return {
        "name": name,
        "color": color,
        "targets": scores.targets,
        "auc": _figure(scores.auc.mean) + (f" ± {_figure(scores.auc.sd)}" if scores.draws > 1 else ""),
        "iou": [_figure(scores.iou.mean[place], 2) for place in places],
        "pck": _figure(scores.pck.mean[places[-1]], 2),
        "symmetric": _figure(scores.symmetric_pck.mean[places[-1]], 2),
        "either_front": _figure(scores.either_front_pck.mean[places[-1]], 2),
        "precision": _figure(scores.presence.precision.mean, 2),
        "recall": _figure(scores.presence.recall.mean, 2),
        "ceiling": _figure(scores.ceiling, 2),
    }


def _spread(scores: ClassScores) -> str:
    return f"± {scores.auc.sd:.3f} over {counted(scores.draws, 'draw')}" if scores.draws > 1 else "1 draw of shots"


def _figure(value: float, digits: int = 3) -> str:
    text = f"{value:.{digits}f}"
    return text[1:] if text.startswith("0.") else text


def _threshold(scores: ClassScores, place: int) -> str:
    return _figure(scores.thresholds[place], 2)


def _run(run: Run, rows: list[dict[str, Any]]) -> dict[str, Any]:
    shots = run.config.file.shots
    classes = len({row["category"] for row in rows})
    line = f"{run.config.dataset.kind} · {counted(len(rows), 'shape')} of {counted(classes, 'class')} · {few(shots)}"
    encoder = getattr(run.config.params.get("extract"), "encoder", None)
    made = time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime())
    return {
        "name": run.name,
        "shots": counted(shots.count, "shot"),
        "line": f"{line} · {encoder}" if encoder else line,
        "made": made,
        "version": version("b23d"),
        "location": f"run file {run.config.path.name}" + "".join(f", --set {text}" for text in run.config.overrides),
    }


def _draws(plan: Plan) -> list[dict[str, Any]]:
    return [
        {"category": d.category, "seed": d.seed, "error": d.error, "shots": [shot.id for shot in d.shots]}
        for d in plan.draws
    ]


def _told(rows: list[dict[str, Any]]) -> dict[str, Known]:
    """Class → what its predictions tell."""
    classes: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        if row["predicted"] is not None:
            classes.setdefault(row["category"], []).append(row)
    keys = ("confidence", "of_class")
    return {name: Known(*(any(row[key] is not None for row in own) for key in keys)) for name, own in classes.items()}


def _curves(table: ScoreTable) -> str:
    from b23d.stages.workbench.pictures.figures import score_curves

    return str(score_curves(table).to_json())


def _static(name: str) -> str:
    return (HERE / "static" / name).read_text()


def _markup() -> Any:
    from markupsafe import Markup

    return Markup
