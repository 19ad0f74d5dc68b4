"""One thing that is another than before: a field of a run file, a stage's version, a shape's bytes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from b23d.schemas.wording import bare


@dataclass(frozen=True)
class Change:
    """From one value to another."""

    field: str
    """`stages.<stage>.<parameter>`, `<stage>.version`, or `<leaf> of <shape>`."""
    old: Any
    new: Any

    def __str__(self) -> str:
        return f"{self.field}: {bare(self.old)} → {bare(self.new)}"

    @property
    def step(self) -> str:
        """The same as a label among others of stages: without `stages.`."""
        return str(self).removeprefix("stages.")
