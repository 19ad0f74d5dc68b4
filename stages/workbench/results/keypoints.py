"""A run's predicted keypoints in the coordinates of the shapes' own files, one row a keypoint."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from b23d.pipeline.dataset import Shape
from b23d.pipeline.planning.nodes import Node, State
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.planning.selection import EVERYTHING, Selection
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import feeding
from b23d.schemas.predictions import Prediction
from b23d.schemas.shape import NormalizedShape
from b23d.stages.datasets.names import keypoint_names
from b23d.stages.workbench.results.columns import STRANGE
from b23d.stages.workbench.results.placing import Placer
from b23d.stages.workbench.results.untold import Known, untold

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = {
    "class": "string",
    "shape": "string",
    "id": "Int64",
    "name": "string",
    "x": "float64",
    "y": "float64",
    "z": "float64",
    "vertex": "Int64",
    "face": "Int64",
    "b0": "float64",
    "b1": "float64",
    "b2": "float64",
    "confidence": "float64",
    "present": "boolean",
    "of_class": "float64",
}
"""In this order; `draw` stands behind `shape` where the rows are of several draws."""


@dataclass(frozen=True)
class FoundKeypoints:
    """The rows, and what became of the draws."""

    table: pd.DataFrame
    draws: dict[str, list[int]]
    """Class → the draws that made its rows."""
    alike: dict[str, list[int]]
    """Class → draws that have the very shots of one that is kept: the same prediction, not repeated."""
    others: dict[str, list[int]]
    """Class → draws that could be asked for besides."""
    waiting: int
    """Shapes that were chosen and have no prediction yet."""
    untold: list[str] = field(default_factory=list)
    """Which of `confidence` and `of_class` no row of some class has, and why."""

    def strangers(self) -> list[str]:
        """Names of shapes that are more probably not of their class, by the mean over draws."""
        known = self.table.dropna(subset="of_class")
        sure = known.groupby(["class", "shape"], sort=False)["of_class"].mean()
        return [f"{category}/{shape}" for category, shape in sure.index[sure < STRANGE]]


def keypoint_table(
    run: Run,
    selection: Selection = EVERYTHING,
    draws: Iterable[int] | None = None,
    watch: Callable[[int, int], None] = lambda done, total: None,
) -> FoundKeypoints:
    """Every predicted keypoint of the chosen shapes, by default with each class's first draw of shots alone.

    draws: which; every draw with its shots differing
    from those of the draws before is kept. Columns, by `COLUMNS`:
    x, y, z: in the file's own coordinates. vertex: the file's nearest vertex (or cloud point), counted from 0 in the
    file's order. face, b0, b1, b2: the face it lies on and where, by barycentric coordinates of its three corners;
    counted from 0 among the file's triangles, polygons cut into theirs in place. Both are absent (NA) where the
    surface is not the file's (`stages.normalize.watertight`), faces for clouds as well.
    confidence: 0 … 1, presuming that the shape is of its class; NA where the method has none (only `posterior` and
    trained heads tell it). present: False where the id is judged absent from this shape.
    of_class: the probability that the shape is of its shots' class at all, the same in all its rows: where it is low,
    confidence means little. NA with a single shot or copies of one, which cannot tell, and where another stage than
    `optimize` predicts. `untold` says which and why.

    Raises SelectionError where `selection` names what is not there.
    """
    plan, names = run.plan(), selection.targets(run.shapes)
    chosen = [shape for shape in run.shapes if shape.name in names]
    final, base = feeding(run.config.file, "optimize"), feeding(run.config.file, "normalize")
    kept, alike = _draws(plan, draws)
    rows: list[dict[str, Any]] = []
    named = keypoint_names(run.shapes)
    used: dict[str, set[int]] = {}
    waiting = 0
    for done, shape in enumerate(chosen, 1):
        nodes = _nodes(plan.by_shape, final, shape, kept.get(shape.category, []), draws is None)
        made = [(draw, node) for draw, node in nodes if node.state is State.CACHED]
        waiting += bool(nodes) and not made
        if made:
            at = plan.by_shape[base, shape.name, None]
            placer = Placer(shape, run.store.read(base, at.address, NormalizedShape))
            for draw, node in made:
                used.setdefault(shape.category, set()).update(() if draw is None else (draw,))
                prediction = run.store.read(final, node.address, Prediction)
                rows += [
                    {"draw": draw, **row} for row in _rows(shape, prediction, placer, named.get(shape.category, {}))
                ]
        watch(done, len(chosen))
    shown = {name: sorted(seeds) for name, seeds in used.items()}
    others = {name: [seed for seed in kept[name] if seed not in seeds] for name, seeds in shown.items()}
    frame = _frame(rows)
    told = {
        str(name): Known(bool(each["confidence"].notna().any()), bool(each["of_class"].notna().any()))
        for name, each in frame.groupby("class", sort=True)
    }
    return FoundKeypoints(frame, shown, alike, others, waiting, untold(run, told))


def _draws(plan: Plan, wanted: Iterable[int] | None) -> tuple[dict[str, list[int]], dict[str, list[int]]]:
    """Class → the draws to show in order, and those left out because they have the shots of one before."""
    kept: dict[str, list[int]] = {}
    alike: dict[str, list[int]] = {}
    seen: dict[str, set[tuple[str, ...]]] = {}
    asked = None if wanted is None else set(wanted)
    for draw in plan.draws:
        if draw.error or (asked is not None and draw.seed not in asked):
            continue
        shots = tuple(shot.id for shot in draw.shots)
        known = tuple(sorted(shots)) in seen.setdefault(draw.category, set())
        (alike if known else kept).setdefault(draw.category, []).append(draw.seed)
        seen[draw.category].add(tuple(sorted(shots)))
    return kept, alike


def _nodes(
    by_shape: dict[tuple[str, str, int | None], Node], stage: str, shape: Shape, draws: list[int], first: bool
) -> list[tuple[int | None, Node]]:
    """The shape's nodes of `stage`: of each of these draws, or of the `first` that has one; of none where the stage
    sees no shots."""
    found: list[tuple[int | None, Node]] = [
        (draw, node) for draw in draws if (node := by_shape.get((stage, shape.name, draw))) is not None
    ]
    if not found and (node := by_shape.get((stage, shape.name, None))) is not None:
        found = [(None, node)]
    ready = [pair for pair in found if pair[1].state is State.CACHED]
    return (ready or found)[:1] if first else found


def _rows(shape: Shape, found: Prediction, placer: Placer, names: dict[int, str]) -> list[dict[str, Any]]:
    places = placer.place(found.points, found.positions)
    confidence = found.confidence
    return [
        {
            "class": shape.category,
            "shape": shape.id,
            "id": number,
            "name": names.get(number),
            **place.columns(),
            "confidence": None if confidence is None else float(confidence[i]),
            "present": bool(found.present[i]),
            "of_class": found.class_confidence,
        }
        for i, (number, place) in enumerate(zip(found.ids.tolist(), places, strict=True))
    ]


def _frame(rows: list[dict[str, Any]]) -> pd.DataFrame:
    import pandas as pd

    table = pd.DataFrame(rows, columns=["draw", *COLUMNS]).astype({"draw": "Int64", **COLUMNS})
    if table["draw"].nunique() > 1:
        return table[["class", "shape", "draw", *list(COLUMNS)[2:]]]
    return table.drop(columns="draw")
