"""What an analysis takes and gives: executed runs, and a table with charts and pictures."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from operator import attrgetter
from typing import Any

import numpy as np
import pandas as pd
import plotly.graph_objects as go

from b23d.pipeline.run import Run
from b23d.schemas.features import PointFeatures
from b23d.schemas.params import Params
from b23d.schemas.shape import NormalizedShape
from b23d.stages.workbench.results.gathering import Gathering, ShapeResults


class AnalysisParams(Params):
    """Base of every `[analysis]` table. None of it enters an address."""

    kind: str
    paper: str = ""
    """What the paper says of it, quoted under the title."""


@dataclass
class ExecutedMember:
    """One executed run of an analysis: a value of a sweep, a variant, or the run itself."""

    label: str
    series: str
    """The swept field, "variants", or "" for the run itself."""
    run: Run

    @cached_property
    def entries(self) -> dict[str, ShapeResults]:
        """Shape's name → what the run has of it; shapes that failed are left out."""
        gathered = Gathering(self.run)
        found = {shape.name: gathered.entry(shape) for shape in self.run.shapes}
        return {name: entry for name, entry in found.items() if entry.normalized is not None}

    @property
    def value(self) -> Any:
        """The swept field's value in this run; the label where that is no field of a stage."""
        words = self.series.split(".")
        if len(words) >= 3 and words[0] == "stages" and words[1] in self.run.config.params:
            return attrgetter(".".join(words[2:]))(self.run.config.params[words[1]])
        return self.label

    def described(self) -> Iterator[tuple[ShapeResults, NormalizedShape, PointFeatures]]:
        """Every shape that has features. Raises ValueError where none has."""
        found = [
            (e, e.normalized, e.features)
            for e in self.entries.values()
            if e.normalized is not None and e.features is not None
        ]
        if not found:
            raise ValueError(f"{self.label}: expected shapes with features, got none; see what failed with b23d run")
        yield from found


@dataclass(frozen=True)
class Chart:
    """A plotly figure with the words below it."""

    figure: go.Figure
    caption: str


@dataclass(frozen=True)
class Scale:
    """What a picture's colours mean: from `low` to `high`."""

    title: str
    low: str
    high: str


@dataclass(frozen=True)
class Pictures:
    """Pictures in lines: each line has a title, and pictures (row, column, 4) uint8 with a label."""

    title: str
    caption: str
    lines: list[tuple[str, list[tuple[str, np.ndarray]]]]
    scale: Scale | None = None


@dataclass
class Result:
    """What an analysis found."""

    title: str
    table: pd.DataFrame
    note: str
    """What the table's columns mean."""
    blocks: list[Chart | Pictures] = field(default_factory=list)


def classes_of(part: ExecutedMember) -> list[str]:
    """The classes of a run's shapes, sorted."""
    return sorted({entry.shape.category for entry in part.entries.values()})
