"""From scores of single shapes to the table of a run: sums over a class, then mean and spread over draws of shots."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Iterable

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
    by_class: dict[str, dict[Hashable, dict[str, ShapeScore]]] = defaultdict(lambda: defaultdict(dict))
    for category, draw, shape, scored in rows:
        by_class[category][draw][shape] = scored
    scores = [one for draws in by_class.values() for shapes in draws.values() for one in shapes.values()]
    if not scores:
        raise ValueError(
            f"scores of {run}: expected at least one scored shape, got none; run it first, or see its quarantine"
        )
    thresholds = scores[0].thresholds.tolist()
    if any(one.thresholds.tolist() != thresholds for one in scores):
        raise ValueError(f"scores of {run}: expected the same thresholds for every shape, got several; re-run score")

    figures = {
        c: {d: _figures(list(shapes.values())) for d, shapes in draws.items()} for c, draws in sorted(by_class.items())
    }
    targets = {c: len({shape for shapes in draws.values() for shape in shapes}) for c, draws in by_class.items()}
    files = {
        c: {one.annotation_file for shapes in draws.values() for one in shapes.values()} - {""}
        for c, draws in by_class.items()
    }
    return ScoreTable(
        run=run,
        protocol=protocol if protocol is not None else " | ".join(sorted({one.protocol for one in scores})),
        classes={c: _scores(list(draws.values()), thresholds, targets[c], files[c]) for c, draws in figures.items()},
        mean=_scores(_over_classes(figures), thresholds, sum(targets.values()), set().union(*files.values())),
    )


def _figures(shapes: list[ShapeScore]) -> Figures:
    """Micro-averages over the shapes of one class in one draw."""

    def total(field: str) -> np.ndarray:
        return np.asarray(np.sum([getattr(shape, field) for shape in shapes], axis=0, dtype=np.int64))

    annotated, predicted, common, met = total("annotated"), total("predicted"), total("common"), total("matched")
    shared, either = total("ceiling")
    true = total("true_positives")
    iou = _ratio(true, true + total("false_positives") + total("false_negatives"))
    return {
        "iou": iou,
        "auc": iou.mean(),
        "pck": _ratio(total("labelled"), annotated),
        "symmetric_pck": _ratio(total("symmetric"), annotated),
        "one_to_one": _ratio(met, annotated + predicted - met),
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
    if not shared:
        return [_mean([_mean(list(draws.values())) for draws in classes])]
    return [_mean([draws[draw] for draws in classes]) for draw in shared]


def _mean(figures: list[Figures]) -> Figures:
    return {name: np.mean([one[name] for one in figures], axis=0) for name in figures[0]}


def _scores(draws: list[Figures], thresholds: list[float], targets: int, files: set[str]) -> ClassScores:
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
        one_to_one=curve("one_to_one"),
        presence=PresenceScores(precision=spread("precision"), recall=spread("recall")),
        ceiling=float(stacked["ceiling"].mean()),
        annotation_files=sorted(files),
    )
