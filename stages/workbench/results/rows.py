"""One line a shape: what the table sorts and filters by."""

from __future__ import annotations

from typing import Any

from b23d.stages.workbench.results.columns import COLUMNS
from b23d.stages.workbench.results.gathering import ShapeResults


def row(found: ShapeResults) -> dict[str, Any]:
    """The table's line of a shape: facts that filters and the 3D view need, then the value of every column."""
    shape = found.normalized
    return {
        "id": found.shape.id,
        "category": found.shape.category,
        "kind": None if shape is None else shape.kind,
        "points": None if shape is None else len(shape.points),
        "shot": found.shot_of,
        "errors": found.errors,
        "state": _state(found),
        "lack": found.lack,
        **{column.key: column.value(found) for column in COLUMNS},
    }


def _state(found: ShapeResults) -> str:
    if found.errors:
        return "failed"
    return "waiting" if found.waiting else "unpredicted" if found.lack else "done"
