"""keypoints: predictions on views of the shapes, beside the annotated shots, and their scores (the paper's real-world
scans)."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pandas as pd

from b23d.schemas.views import Views
from b23d.schemas.wording import averaged
from b23d.stages.geometry.cameras import project
from b23d.stages.workbench.analyses.interface import AnalysisParams, ExecutedMember, Pictures, Result, classes_of
from b23d.stages.workbench.pictures.painting import Mark, marks, nearest_view
from b23d.stages.workbench.pictures.palette import id_color
from b23d.stages.workbench.results.gathering import ShapeResults

PIXELS = 336
RADIUS, INNER = 8, 6  # pixels: of rings and of discs
ROOM = 1.1


class Parameters(AnalysisParams):
    kind: Literal["keypoints"]
    draw: int | None = None
    """Which draw of shots is shown; None: the first."""


def needs(params: Parameters) -> list[str]:
    return ["normalize", "render", "score"]


def analyse(parts: list[ExecutedMember], params: Parameters) -> Result:
    """Raises ValueError where nothing is scored, that is where no shape but the shots is annotated."""
    from b23d.stages.workbench.results.scores import run_scores

    rows: list[dict[str, object]] = []
    blocks, draws = [], 1
    for part in parts:
        table = run_scores(part.run)
        draws = max(draws, table.mean.draws)
        for name, scores in [*table.classes.items(), *([("mean", table.mean)] if len(table.classes) > 1 else [])]:
            middle = _at(scores.thresholds, scores.iou.mean, 0.05)
            rows.append({
                "variant": part.label, "class": name, "AUC": scores.auc.mean,
                "AUC sd": scores.auc.sd if scores.draws > 1 else np.nan,  # one draw tells no spread
                "IoU .05": middle,
                "IoU .10": scores.iou.mean[-1], "PCK .10": scores.pck.mean[-1], "targets": scores.targets,
                "draws": scores.draws,
            })  # fmt: skip
    for category in classes_of(parts[0]):
        lines = [(part.label, _drawn(part, category, params.draw)) for part in parts]
        caption = (
            "Shots with their annotated keypoints as rings; "
            "then targets, with predicted keypoints as discs, annotated ones as rings."
        )
        blocks.append(Pictures(category, caption, lines))
    return Result(
        "Keypoints predicted from a few annotated shapes", pd.DataFrame(rows),
        f"AUC: mean IoU over thresholds 0 … .10; PCK: labelled; {averaged(draws)}.",
        list(blocks),
    )  # fmt: skip


def _drawn(part: ExecutedMember, category: str, draw: int | None) -> list[tuple[str, np.ndarray]]:
    shots, targets = [], []
    seeds = sorted(
        {seed for entry in part.entries.values() for seed in [*entry.shot_of, *(a.draw for a in entry.attempts)]}
    )
    shown = draw if draw is not None else next(iter(seeds), None)
    for entry in part.entries.values():
        if entry.shape.category != category or entry.views is None:
            continue
        if shown in entry.shot_of:
            assert entry.keypoints is not None
            truth = zip(entry.keypoints.ids, entry.true_positions(), strict=True)
            shots.append(
                (f"{entry.shape.id}: shot", on_view(entry.views, [Mark(at, int(number), True) for number, at in truth]))
            )
        elif (attempt := entry.attempt(shown)) is not None:
            targets.append((_label(entry), on_view(entry.views, marks(entry, attempt.prediction))))
    return shots + targets


def _label(entry: ShapeResults) -> str:
    return entry.shape.id if entry.keypoints is not None else f"{entry.shape.id}: not annotated"


def on_view(views: Views, keypoints: list[Mark]) -> np.ndarray:
    """(row, column, 4) uint8: the view from the front right, a little from above, cut to the shape; hidden keypoints
    are drawn, too."""
    from PIL import Image, ImageDraw

    at = nearest_view(views)
    left, top, side = _box(views.depth[at])
    box = (left, top, left + side, top + side)
    image = (
        Image.fromarray(views.images[at])
        .convert("RGBA")
        .transform(
            (PIXELS, PIXELS), Image.Transform.EXTENT, box, Image.Resampling.BICUBIC, fillcolor=(255, 255, 255, 255)
        )
    )
    if not keypoints:
        return np.asarray(image)
    draw, scale = ImageDraw.Draw(image), PIXELS / side
    pixels, _ = project(
        np.stack([mark.position for mark in keypoints]).astype(np.float64),
        views.world_to_camera[[at]],
        views.intrinsics,
    )
    cut = (pixels[0] - (left, top)) * scale
    places = {(mark.true, mark.id): tuple(place) for mark, place in zip(keypoints, cut.tolist(), strict=True)}
    for (true, number), place in places.items():
        if not true and (True, number) in places:
            draw.line([place, places[True, number]], fill=(220, 38, 38), width=2)
    for (true, number), (x, y) in sorted(places.items(), reverse=True):
        box = (x - RADIUS, y - RADIUS, x + RADIUS, y + RADIUS)
        if true:
            draw.ellipse(box, outline=(255, 255, 255), width=6)
            draw.ellipse(box, outline=id_color(number), width=4)
        else:
            draw.ellipse((x - INNER, y - INNER, x + INNER, y + INNER), fill=id_color(number), outline=(255, 255, 255))
    return np.asarray(image)


def _box(depth: np.ndarray) -> tuple[float, float, float]:
    """Left, top and side of the square around what is seen in a view, with room for keypoints at its edge; pixels."""
    rows, columns = np.flatnonzero((depth > 0).any(axis=1)), np.flatnonzero((depth > 0).any(axis=0))
    if not len(rows):
        return 0.0, 0.0, float(len(depth))
    side = ROOM * (max(np.ptp(rows), np.ptp(columns)) + 1)
    return float(columns[0] + columns[-1] + 1 - side) / 2, float(rows[0] + rows[-1] + 1 - side) / 2, float(side)


def _at(thresholds: list[float], values: list[float], wanted: float) -> float:
    return values[min(range(len(thresholds)), key=lambda place: abs(thresholds[place] - wanted))]
