"""Classes of which nothing is predicted, since nothing of them is annotated: said where a run is told of."""

from __future__ import annotations

from collections import defaultdict

from b23d.pipeline.inspection.proposing import proposed
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.run import Run

SHOWN = 5  # classes that a line names


def unannotated_notes(run: Run, plan: Plan) -> list[str]:
    """A line for all such classes, with the command that helps; none where no class is annotated: that is a problem of
    the plan, and told as one."""
    if plan.unannotated:
        return []
    classes: dict[str, list[str]] = defaultdict(list)
    for category, lack in plan.unannotated_classes.items():
        classes[lack].append(category)
    return [f"{_named(names)}: {lack}{remedy(run)}" for lack, names in classes.items()]


def remedy(run: Run) -> str:
    """What helps against a lack of annotations, to end a line with; "" where the data set's are not ours to write."""
    return "" if run.config.dataset.annotations_kept() else f"; {proposed('annotate', run)}"


def _named(classes: list[str]) -> str:
    more = f" and {len(classes) - SHOWN} more" if len(classes) > SHOWN else ""
    return f"class{'es' if len(classes) > 1 else ''} {', '.join(classes[:SHOWN])}{more}"
