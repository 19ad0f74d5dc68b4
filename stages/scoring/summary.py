"""From scores of single shapes to the table of a run: sums over a class, then mean and spread over draws of shots."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable
from dataclasses import dataclass, field

import numpy as np

from b23d.schemas.scores import ClassScores, Curve, PresenceScores, ScoreTable, ShapeScore, Spread

ScoreRow = tuple[str, Hashable, str, ShapeScore]
"""Category, draw, shape, score."""
Figures = dict[str, np.ndarray]
"""Name → (t,) or () float64: one class in one draw."""


def score_table(run: str, protocol: str | None, rows: Iterable[ScoreRow]) -> ScoreTable:
    """The table of `rows`; classes are sorted by name.

    protocol: as printed in the table; None takes what the scores themselves say.
    Raises ValueError where there is no row, or where thresholds differ.
    """
    classes = _by_class(rows)
    scores = [score for gathered in classes.values() for score in gathered.scores()]
    thresholds = _thresholds(run, scores)

    tables = {name: gathered.table(thresholds) for name, gathered in classes.items()}
    mean = _class_scores(
        _over_classes({name: gathered.figures() for name, gathered in classes.items()}),
        thresholds,
        targets=sum(table.targets for table in tables.values()),
        files={file for gathered in classes.values() for file in gathered.files()},
    )

    if protocol is None:
        protocol = " | ".join(sorted({score.protocol for score in scores}))
    return ScoreTable(run=run, protocol=protocol, classes=tables, mean=mean)


@dataclass
class ClassResults:
    """The scores of one class: draw → shape → score."""

    draws: dict[Hashable, dict[str, ShapeScore]] = field(default_factory=lambda: defaultdict(dict))

    def scores(self) -> list[ShapeScore]:
        return [score for shapes in self.draws.values() for score in shapes.values()]

    def figures(self) -> dict[Hashable, Figures]:
        """Draw → figures of all its shapes together."""
        return {draw: _figures(list(shapes.values())) for draw, shapes in self.draws.items()}

    def files(self) -> set[str]:
        """The annotation files that were scored against."""
        return {score.annotation_file for score in self.scores()} - {""}

    def table(self, thresholds: list[float]) -> ClassScores:
        targets = {shape for shapes in self.draws.values() for shape in shapes}
        return _class_scores(list(self.figures().values()), thresholds, len(targets), self.files())


def _by_class(rows: Iterable[ScoreRow]) -> dict[str, ClassResults]:
    """Class → its scores, sorted by class."""
    found: dict[str, ClassResults] = defaultdict(ClassResults)
    for category, draw, shape, score in rows:
        found[category].draws[draw][shape] = score
    return dict(sorted(found.items()))


def _thresholds(run: str, scores: list[ShapeScore]) -> list[float]:
    """The thresholds that all scores have."""
    if not scores:
        raise ValueError(
            f"scores of {run}: expected at least one scored shape, got none; run it first, or see its quarantine"
        )
    thresholds = scores[0].thresholds.tolist()
    if any(score.thresholds.tolist() != thresholds for score in scores):
        raise ValueError(f"scores of {run}: expected the same thresholds for every shape, got several; re-run score")
    return [float(threshold) for threshold in thresholds]


def _figures(shapes: list[ShapeScore]) -> Figures:
    """Micro-averages over the shapes of one class in one draw."""

    def total(name: str) -> np.ndarray:
        return np.asarray(np.sum([getattr(shape, name) for shape in shapes], axis=0, dtype=np.int64))

    annotated, predicted, common = total("annotated"), total("predicted"), total("common")
    true, false, missed = total("true_positives"), total("false_positives"), total("false_negatives")
    matched = total("matched")
    shared, either = total("ceiling")

    iou = _ratio(true, true + false + missed)
    return {
        "iou": iou,
        "auc": iou.mean(),
        "pck": _ratio(total("labelled"), annotated),
        "symmetric_pck": _ratio(total("symmetric"), annotated),
        "either_front_pck": _ratio(total("either_front"), annotated),
        "one_to_one": _ratio(matched, annotated + predicted - matched),
        "precision": _ratio(common, predicted),
        "recall": _ratio(common, shared),
        "ceiling": _ratio(shared, either),
    }


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """part / whole, 0 where the whole is 0."""
    return np.asarray(part / np.maximum(whole, 1), np.float64)


def _over_classes(figures: dict[str, dict[Hashable, Figures]]) -> list[Figures]:
    """Mean over classes in each draw that all classes have; without such a draw, the mean of the classes' own means."""
    classes = list(figures.values())
    shared = [draw for draw in classes[0] if all(draw in draws for draws in classes)]
    if shared:
        return [_mean([draws[draw] for draws in classes]) for draw in shared]
    own = [_mean(list(draws.values())) for draws in classes]
    return [_mean(own)]


def _mean(figures: list[Figures]) -> Figures:
    return {name: np.mean([one[name] for one in figures], axis=0) for name in figures[0]}


def _class_scores(draws: list[Figures], thresholds: list[float], targets: int, files: set[str]) -> ClassScores:
    stacked = {name: np.stack([one[name] for one in draws]) for name in draws[0]}  # (draw, t) or (draw,)

    def sd(values: np.ndarray) -> np.ndarray:
        return values.std(0, ddof=1) if len(values) > 1 else np.zeros(values.shape[1:])

    def curve(name: str) -> Curve:
        return Curve(mean=stacked[name].mean(0).tolist(), sd=sd(stacked[name]).tolist())

    def spread(name: str) -> Spread:
        return Spread(mean=float(stacked[name].mean()), sd=float(sd(stacked[name])))

    return ClassScores(
        targets=targets,
        draws=len(draws),
        thresholds=thresholds,
        iou=curve("iou"),
        auc=spread("auc"),
        pck=curve("pck"),
        symmetric_pck=curve("symmetric_pck"),
        either_front_pck=curve("either_front_pck"),
        one_to_one=curve("one_to_one"),
        presence=PresenceScores(precision=spread("precision"), recall=spread("recall")),
        ceiling=float(stacked["ceiling"].mean()),
        annotation_files=sorted(files),
    )
