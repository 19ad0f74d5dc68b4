"""Why `confidence` or `of_class` is empty: what a method, or a draw of shots, cannot tell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import feeding
from b23d.schemas.wording import counted


@dataclass(frozen=True)
class Known:
    """What some prediction of a class has told."""

    confidence: bool
    of_class: bool


def untold(run: Run, classes: Mapping[str, Known]) -> list[str]:
    """A line for each of the two that no prediction of some class has, with the reason. classes: those predicted."""
    lines = []
    for name, reason in (("confidence", _no_confidence(run)), ("of_class", _no_class(run))):
        lacking = sorted(category for category, told in classes.items() if not getattr(told, name))
        if lacking:
            whose = "" if len(lacking) == len(classes) else f" of {', '.join(lacking)}"
            lines.append(f"{name}{whose} is empty: {reason}")
    return lines


def _no_confidence(run: Run) -> str:
    stage = feeding(run.config.file, "optimize")
    method = getattr(run.config.params.get(stage), "method", None)
    if stage != "optimize":
        return f"{stage} tells none"
    return f"the method {method} tells none; stages.optimize.method=posterior does"


def _no_class(run: Run) -> str:
    stage, shots = feeding(run.config.file, "optimize"), run.config.file.shots.count
    if stage != "optimize":
        return f"{stage} does not judge whether a shape is of its class"
    copies = "" if shots == 1 else ", or copies of one,"
    given = f"{counted(1, 'shot')}{copies} cannot tell how much shapes of a class differ"
    return f"{given}; take two shots or more that differ"
