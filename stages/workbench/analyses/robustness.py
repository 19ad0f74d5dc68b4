"""robustness: keypoints found on bad scans against those found on the same shapes clean (the paper's claim of
robustness)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
import plotly.graph_objects as go
from pydantic import Field

from b23d.schemas.wording import averaged
from b23d.stages.scoring.iou import count, within
from b23d.stages.workbench.analyses.drawing import SOFT, finish
from b23d.stages.workbench.analyses.interface import AnalysisParams, Chart, ExecutedMember, Pictures, Result
from b23d.stages.workbench.pictures.painting import marks, picture
from b23d.stages.workbench.pictures.palette import class_color
from b23d.stages.workbench.results.gathering import Attempt, ShapeResults
from b23d.stages.workbench.results.matching import present_ids

PIXELS = 336
THRESHOLDS = np.arange(11) / 100
"""Distances that AUC is the mean IoU over, in clean sizes."""


class Parameters(AnalysisParams):
    kind: Literal["robustness"]
    radius: float = Field(0.1, gt=0)
    """Within this of its keypoint a prediction is right: PCK's, in longest sides of the clean shape."""
    worst: int = Field(3, ge=1)
    """How many shapes are drawn of each damage: those that lose most."""


@dataclass(frozen=True)
class Judged:
    """One target under one damage, in one draw of shots."""

    category: str
    distances: np.ndarray
    """(k, g) of predictions from keypoints, in clean sizes."""
    own: np.ndarray
    """(g,) that of each keypoint's own id; inf where that is not predicted."""
    clean: np.ndarray
    """(g,) the same on the clean shape, of the same keypoints."""
    had: int
    """Keypoints of the clean shape."""

    def lost(self, radius: float) -> float:
        """How much lower the share of right ones is than on the clean shape; 0 where no keypoint is left."""
        right, before = self.own <= radius, self.clean <= radius
        return float(before.mean() - right.mean()) if len(right) else 0.0


Targets = dict[tuple[str, int], Judged]
"""Shape's name and draw → what came of it."""


def needs(params: Parameters) -> list[str]:
    return ["normalize", "score"]


def analyse(parts: list[ExecutedMember], params: Parameters) -> Result:
    """Raises ValueError where a damage has no clean run of the same geometry beside it, or nothing is scored."""
    rows, lines, draws = [], [], 1
    for part in parts:
        reference = _reference(part, parts)
        targets = dict(_judged(part, reference))
        if not targets:
            raise ValueError(
                f"{part.label}: expected scored targets, got none; "
                "annotate shapes beyond dataset.damage.clean, or see what failed with b23d run"
            )
        draws = max(draws, len({draw for _, draw in targets}))
        loss = _losses(targets, params.radius)
        rows.append({"scan": part.label, **_row(targets, params.radius), "worst": loss.index[0]})
        if part is not reference:
            chosen = loss.index[: params.worst]
            lines.append(
                (
                    part.label,
                    [drawn for name in chosen for drawn in _drawn(name, part, reference, targets, params.radius)],
                )
            )
    table = pd.DataFrame(rows)
    sizes = f"{params.radius:g} longest sides of the clean shape"
    caption = (
        "Each shape clean, then damaged: annotated keypoints as rings, predicted ones as discs, joined where the "
        f"id is the same. Below: the share found within {sizes}, in the first draw. "
        "`b23d show` and `b23d report` open a shape's views and features."
    )
    return Result(
        "Keypoints on bad scans", table,
        "Shots are clean, targets damaged. AUC: mean IoU over thresholds 0 … .10, PCK: keypoints whose own id is "
        f"predicted within {sizes}; mean over classes; {averaged(draws)}. clean: PCK of the same shapes and "
        "keypoints without the damage; left: share of the keypoints whose surface is still there; worst: the shape "
        "that loses most.",
        [
            Chart(_figure(table, draws), "PCK on damaged targets, and of the same keypoints on the clean ones."),
            Pictures("What suffers most", caption, lines),
        ],
    )  # fmt: skip


def _damage(part: ExecutedMember) -> Any:
    damage = getattr(part.run.config.dataset, "damage", None)
    if damage is None:
        raise ValueError(
            f"{part.label}: expected a data set that can be damaged, got {part.run.config.dataset.kind}; "
            'take "procedural", "keypointnet" or "folder"'
        )
    return damage


def _reference(part: ExecutedMember, parts: list[ExecutedMember]) -> ExecutedMember:
    """The run that has the same shapes clean: as many points, no damage."""
    for other in parts:
        if _damage(other).kind == "none" and _damage(other).points == _damage(part).points:
            return other
    raise ValueError(
        f'{part.label}: expected a variant with dataset.damage.kind = "none" and as many points beside it, got none; '
        "add one to [variants]"
    )


def _judged(part: ExecutedMember, reference: ExecutedMember) -> Iterator[tuple[tuple[str, int], Judged]]:
    for name, entry in part.entries.items():
        before = reference.entries.get(name)
        for attempt in entry.attempts if before is not None else ():
            first = before.attempt(attempt.draw) if before is not None else None
            if before is None or first is None or attempt.score is None or first.score is None:
                continue
            assert entry.keypoints is not None and before.keypoints is not None
            size, clean_size = _size(entry, before), _size(before, before)
            clean = own_distances(before, first, clean_size)
            own = own_distances(entry, attempt, size)
            yield (
                (name, attempt.draw),
                Judged(
                    entry.shape.category,
                    attempt.score.distances.astype(np.float64) / size,
                    np.array(list(own.values())),
                    np.array([clean[number] for number in own]),
                    len(before.keypoints.ids),
                ),
            )


def own_distances(entry: ShapeResults, attempt: Attempt, size: float) -> dict[int, float]:
    """Id of each annotated keypoint → how far its prediction is along the surface, in sizes; inf: not predicted."""
    assert entry.keypoints is not None and attempt.score is not None
    rows = {number: row for row, number in enumerate(present_ids(attempt.prediction))}
    found = {}
    for column, number in enumerate(entry.keypoints.ids.tolist()):
        found[number] = float(attempt.score.distances[rows[number], column]) / size if number in rows else float("inf")
    return found


def _size(entry: ShapeResults, clean: ShapeResults) -> float:
    """The clean shape's longest side in the units of `entry`'s scores, whatever its own box: the spread about
    their middle of the keypoints that both have tells by how much it was scaled."""
    assert entry.keypoints is not None and clean.keypoints is not None and clean.normalized is not None
    _, mine, theirs = np.intersect1d(entry.keypoints.ids, clean.keypoints.ids, return_indices=True)
    spreads = [
        float(np.linalg.norm(found.positions[rows] - found.positions[rows].mean(axis=0))) if len(rows) > 1 else 0.0
        for found, rows in ((entry.keypoints, mine), (clean.keypoints, theirs))
    ]
    return clean.normalized.scale * (spreads[0] / spreads[1] if spreads[1] else 1.0)


def _losses(targets: Mapping[tuple[str, int], Judged], radius: float) -> pd.Series:
    """Shape → mean loss over draws, the most first."""
    loss = pd.Series({key: judged.lost(radius) for key, judged in targets.items()})
    return loss.groupby(level=0).mean().sort_values(ascending=False, kind="stable")


def _row(targets: Targets, radius: float) -> dict[str, object]:
    draws = sorted({draw for _, draw in targets})
    each = pd.DataFrame([_means([t for (_, d), t in targets.items() if d == draw], radius) for draw in draws])
    mean, sd = each.mean(), each.std(ddof=1)  # NaN where one draw tells no spread
    return {
        "AUC": mean["auc"], "AUC sd": sd["auc"], "PCK": mean["pck"], "PCK sd": sd["pck"], "clean": mean["clean"],
        "change": mean["pck"] - mean["clean"], "change sd": (each["pck"] - each["clean"]).std(ddof=1),
        "left": mean["left"], "shapes": len({name for name, _ in targets}),
    }  # fmt: skip


def _means(targets: list[Judged], radius: float) -> dict[str, float]:
    """Over the targets of each class, then over classes."""
    rows = []
    for category in sorted({judged.category for judged in targets}):
        members = [judged for judged in targets if judged.category == category]
        counts = [np.stack(count(within(judged.distances, THRESHOLDS, "<="))) for judged in members]
        found, wrong, missed = np.sum(counts, axis=0)
        own, clean = (np.concatenate([getattr(judged, key) for judged in members]) for key in ("own", "clean"))
        rows.append({
            "auc": float((found / np.maximum(found + wrong + missed, 1)).mean()),
            "pck": float((own <= radius).mean()) if len(own) else np.nan,
            "clean": float((clean <= radius).mean()) if len(own) else np.nan,
            "left": len(own) / max(sum(judged.had for judged in members), 1),
        })  # fmt: skip
    return {key: float(value) for key, value in pd.DataFrame(rows).mean().items()}


def _drawn(
    name: str, part: ExecutedMember, reference: ExecutedMember, targets: Targets, radius: float
) -> Iterator[tuple[str, np.ndarray]]:
    judged = next(found for (shape, _), found in targets.items() if shape == name)
    for entry, own, what in (
        (reference.entries[name], judged.clean, "clean"),
        (part.entries[name], judged.own, "damaged"),
    ):
        attempt = entry.attempt()
        assert entry.normalized is not None and attempt is not None
        share = f"{(own <= radius).mean():.0%}" if len(own) else "none left"
        image = picture(entry.normalized, None, PIXELS, marks(entry, attempt.prediction))
        yield f"{name}, {what}: {share}", image


def _figure(table: pd.DataFrame, draws: int) -> go.Figure:
    figure, labels = go.Figure(), table["scan"].tolist()
    spread = {"error_y": {"type": "data", "array": table["PCK sd"].tolist(), "color": SOFT}} if draws > 1 else {}
    figure.add_bar(
        x=labels, y=table["PCK"].tolist(), name=f"damaged, {averaged(draws)}", marker={"color": class_color(0)},
        **spread,
        hovertemplate="%{y:.3f}<extra>%{x}</extra>",
    )  # fmt: skip
    figure.add_scatter(
        x=labels, y=table["clean"].tolist(), name="the same keypoints, clean", mode="markers",
        marker={"symbol": "line-ew-open", "size": 18, "color": class_color(1), "line": {"width": 3}},
        hovertemplate="%{y:.3f} clean<extra>%{x}</extra>",
    )  # fmt: skip
    figure.update_yaxes(range=[0, 1.01])
    finish(figure, "", "PCK", 480)
    figure.update_layout(legend={"y": 1.02, "yanchor": "bottom"}, margin={"b": 130})
    return figure
