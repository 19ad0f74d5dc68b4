"""Two runs side by side: parameters, scores with their spread, shapes that got better and worse, predictions that
moved."""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.run import Run
from b23d.schemas.params import flat
from b23d.schemas.predictions import Prediction
from b23d.schemas.scores import ShapeScore
from b23d.stages.workbench.results.scores import run_scores, spread

Heads = tuple[str, str]
"""What the two runs are called, perhaps over several lines (see `headings`)."""


def parameters(run: Run) -> dict[str, Any]:
    """Every parameter of a run that enters an address or chooses shots, by its dotted name."""
    found = {
        f"stages.{stage}.{key}": value
        for stage, params in run.config.params.items()
        for key, value in flat(params.hashed()).items()
    }
    found |= {f"dataset.{key}": str(value) for key, value in run.config.dataset.model_dump().items()}
    found |= {f"shots.{key}": value for key, value in run.config.file.shots.model_dump().items()}
    return found | {f"feeds.{key}": value for key, value in run.config.file.feeds.items()}


def parameter_table(one: Run, two: Run, heads: Heads) -> Table:
    table = Table("parameter", *map(escape, heads), title="parameters that differ", title_justify="left")
    first, second = parameters(one), parameters(two)
    for name in sorted(first.keys() | second.keys()):
        if first.get(name) != second.get(name):
            table.add_row(*map(escape, (name, str(first.get(name, "–")), str(second.get(name, "–")))))
    return table


def score_table(one: Run, two: Run, heads: Heads) -> Table:
    """IoU and AUC per class of both, mean ± sd over draws, and the change."""
    table = Table("class", "figure", *map(escape, heads), "change", title="scores", title_justify="left")
    first, second = run_scores(one), run_scores(two)
    for name in [*(name for name in first.classes if name in second.classes), "mean"]:
        a, b = (scores.mean if name == "mean" else scores.classes[name] for scores in (first, second))
        figures = [
            (f"IoU {a.thresholds[i]:g}", a.iou.mean[i], a.iou.sd[i], b.iou.mean[i], b.iou.sd[i])
            for i in _shown(a.thresholds)
        ]
        figures.append(("AUC", a.auc.mean, a.auc.sd, b.auc.mean, b.auc.sd))
        for label, one_curve, two_curve in (("PCK", a.pck, b.pck), ("sym. PCK", a.symmetric_pck, b.symmetric_pck)):
            figures.append((label, one_curve.mean[-1], one_curve.sd[-1], two_curve.mean[-1], two_curve.sd[-1]))
        for figure, mean1, sd1, mean2, sd2 in figures:
            table.add_row(
                escape(name), figure, spread(mean1, sd1, a.draws), spread(mean2, sd2, b.draws), f"{mean2 - mean1:+.3f}"
            )
    return table


def shape_scores(run: Run) -> dict[str, float]:
    """Each shape's own mean IoU over thresholds and draws."""
    found = defaultdict(list)
    for shape, _, artifact in run.collect("score"):
        if isinstance(artifact, ShapeScore):
            hits = artifact.true_positives
            found[shape.name].append(
                float(np.mean(hits / np.maximum(1, hits + artifact.false_positives + artifact.false_negatives)))
            )
    return {name: float(np.mean(values)) for name, values in found.items()}


def shape_table(one: Run, two: Run, heads: Heads, most: int) -> Table:
    first, second = shape_scores(one), shape_scores(two)
    change = sorted((second[name] - first[name], name) for name in first.keys() & second.keys())
    table = Table(
        "shape", *map(escape, heads), "change", title="shapes that changed most (mean IoU)", title_justify="left"
    )
    worse = [row for row in change if row[0] < 0][:most]
    better = [row for row in change if row[0] > 0][-most:]
    for delta, name in [*worse, *better]:
        color = "green" if delta > 0 else "red"
        table.add_row(escape(name), f"{first[name]:.3f}", f"{second[name]:.3f}", f"[{color}]{delta:+.3f}[/]")
    better_count, worse_count = sum(delta > 0 for delta, _ in change), sum(delta < 0 for delta, _ in change)
    table.caption = f"{better_count} better, {worse_count} worse, {len(change) - better_count - worse_count} the same"
    return table


def moved_table(one: Run, two: Run, heads: Heads, most: int) -> Table:
    """Predictions of equal draw and id that moved farthest; Euclidean, unit frame."""
    first, second = _places(one), _places(two)
    moved = sorted(
        ((float(np.linalg.norm(second[key] - first[key])), key) for key in first.keys() & second.keys()), reverse=True
    )
    table = Table("shape", "draw", "id", "moved (unit frame)", title="predictions that moved", title_justify="left")
    for distance, (shape, draw, keypoint) in moved[:most]:
        table.add_row(escape(shape), str(draw), str(keypoint), f"{distance:.3f}")
    still = sum(distance < 1e-6 for distance, _ in moved)
    gone, new = len(first.keys() - second.keys()), len(second.keys() - first.keys())
    table.caption = f"{len(moved) - still} moved, {still} stayed, {gone} only in the first, {new} only in the second"
    return table


def _places(run: Run) -> dict[tuple[str, int | None, int], np.ndarray]:
    found: dict[tuple[str, int | None, int], np.ndarray] = {}
    for shape, draw, artifact in run.collect("optimize"):
        if isinstance(artifact, Prediction):
            rows = zip(artifact.ids, artifact.positions, artifact.present, strict=True)
            found |= {(shape.name, draw, int(i)): position for i, position, present in rows if present}
    return found


def _shown(thresholds: list[float]) -> list[int]:
    return [i for i, threshold in enumerate(thresholds) if round(threshold, 6) in (0.02, 0.05, 0.1)]
