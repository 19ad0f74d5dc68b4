"""The score tables of a run, made of what it has stored."""

from __future__ import annotations

from typing import TYPE_CHECKING

from b23d.pipeline.planning.selection import EVERYTHING, Selection
from b23d.pipeline.run import Run
from b23d.schemas.scores import PartScore, PartTable, ScoreTable, ShapeScore
from b23d.schemas.wording import counted

if TYPE_CHECKING:
    from b23d.stages.scoring.summary import ScoreRow


def run_scores(run: Run, selection: Selection = EVERYTHING) -> ScoreTable:
    """The score table of what a run has scored so far of the selected targets. Raises ValueError where nothing is
    scored yet."""
    from b23d.stages.scoring.summary import score_table

    rows = score_rows(run, selection)
    return score_table(run.name, rows[0][3].protocol, rows)


def spread(mean: float, sd: float, draws: int) -> str:
    """Mean ± sd over draws; the figure alone of one draw, which tells no spread."""
    return f"{mean:.3f} ± {sd:.3f}" if draws > 1 else f"{mean:.3f}"


def coverage(run: Run, stage: str, selection: Selection = EVERYTHING) -> str:
    """ "3 of 5 targets" where a stage has made fewer of the selected ones than the run wants; "" where it has all."""
    wanted = {(shape, draw) for name, shape, draw in run.plan().by_shape if name == stage}
    chosen = _chosen(run, selection)
    made = {(s.name, draw) for s, draw, _ in run.collect(stage) if chosen is None or s.name in chosen}
    if wanted <= made:
        return ""
    shapes, all_shapes = ({shape for shape, _ in pairs} for pairs in (made & wanted, wanted))
    if shapes == all_shapes:
        return f"{len(made & wanted)} of {counted(len(wanted), 'target')} of the draws"
    return f"{len(shapes)} of {counted(len(all_shapes), 'target')}"


def _chosen(run: Run, selection: Selection) -> set[str] | None:
    """Names of the selected shapes; None: all."""
    return selection.targets(run.shapes) if selection.narrows and not selection.only_failed else None


def score_rows(run: Run, selection: Selection = EVERYTHING) -> list[ScoreRow]:
    """Class, draw, shape and score of what a run has scored so far of the selected targets. Raises ValueError where
    that is nothing."""
    wanted = _chosen(run, selection)
    rows: list[ScoreRow] = [
        (shape.category, draw, shape.id, found)
        for shape, draw, found in run.collect("score")
        if isinstance(found, ShapeScore) and draw is not None and (wanted is None or shape.name in wanted)
    ]
    if not rows:
        raise ValueError(
            f"run {run.name}: expected scored shapes, got none; run it first, or annotate shapes that are not shots"
        )
    return rows


def run_parts(run: Run) -> PartTable:
    """The part table of what a run has scored so far. Raises ValueError where the run scores no parts, or none is
    scored yet."""
    from b23d.stages.scoring.parts import part_table

    if "score_parts" not in run.config.stages:
        raise ValueError(
            f'run {run.name}: expected score_parts among its stages, got none; set outputs = ["score_parts"]'
        )
    found = (
        (s.category, draw, s.id, a)
        for s, draw, a in run.collect("score_parts")
        if isinstance(a, PartScore) and draw is not None
    )
    return part_table(run.name, found)
