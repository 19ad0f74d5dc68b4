"""Whether the shapes of a class stand as the run file says: looked at where a run has just normalized some, a few of
each class. What is odd is told at the end of that run, and by later plans and reports: looking at files for every plan
would cost more than the plan."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.markup import escape

from b23d.pipeline.errors import B23dError
from b23d.pipeline.records.warned import remember_lines
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import feeding
from b23d.pipeline.scheduling.execution import Report
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.wording import counted

if TYPE_CHECKING:
    from b23d.stages.geometry.upright import Upright

LOOKED_AT = 6
"""Shapes of each class."""
DRAWN = 200_000
"""Faces above which a shape is not looked at: it would cost seconds."""


def after_run(run: Run, report: Report, console: Console) -> None:
    """Look at what this run has normalized; say, and remember, which classes look mixed or otherwise turned."""
    stage = feeding(run.config.file, "normalize")
    if stage not in run.config.stages or not issubclass(run.config.stages[stage].gives, NormalizedShape):
        return
    made: dict[str, list[str]] = defaultdict(list)
    for outcome in sorted(report.done, key=lambda outcome: outcome.shape):  # not in the order that workers ended in
        if outcome.stage == stage:
            made[outcome.shape.split("/")[0]].append(outcome.address)
    found = {}
    for category, addresses in sorted(made.items()):
        if (line := _class_line(run, stage, category, _spread(addresses))) is not None:
            found[addresses[0]] = [line]
            console.print(f"[yellow]![/] {escape(line)}", highlight=False, soft_wrap=True)
    remember_lines(run.folder, found)


def class_line(category: str, shapes: list[NormalizedShape]) -> str | None:
    """What is odd about how shapes of a class stand; None where nothing is, or they do not tell."""
    from b23d.stages.geometry.upright import guess, stance

    shapes = [shape for shape in shapes if shape.kind == "mesh" and len(shape.faces) <= DRAWN]
    stances = [stance(shape.vertices, shape.faces) for shape in shapes]
    if guess(stances).axis == "y" or not shapes:
        return None
    declared = {shape.up for shape in shapes}
    if len(declared) == 1:  # said in the file's axes, which is what people set
        stances = [
            None if each is None else each.seen_in(shape.rotation.T)
            for each, shape in zip(stances, shapes, strict=True)
        ]
    found = guess(stances)
    if found.mixed:
        return mixed_line(f"class {category}", found)
    if found.axis is None or found.axis in declared:
        return None
    taken = f"taken to have {next(iter(declared))} up" if len(declared) == 1 else "made upright otherwise"
    return (
        f"class {category}: {found.votes} of {counted(found.asked, 'shape')} looked at stand on {found.axis}, "
        f"and are {taken}; look at one, and set dataset.up if so"
    )


def mixed_line(name: str, found: Upright) -> str:
    axes = " and ".join(f"{count} on {axis}" for axis, count in found.mixed)
    return (
        f"{name}: up looks mixed: of {counted(found.asked, 'shape')} looked at, {axes} stand; look at them, "
        "and say which is which with dataset.up: class, shape or pattern → axis"
    )


def _class_line(run: Run, stage: str, category: str, addresses: list[str]) -> str | None:
    try:
        return class_line(category, [run.store.read(stage, address, NormalizedShape) for address in addresses])
    except B23dError:  # gone or damaged: for verify to tell
        return None


def _spread(addresses: list[str]) -> list[str]:
    places = np.unique(np.linspace(0, len(addresses) - 1, min(LOOKED_AT, len(addresses))).astype(int))
    return [addresses[place] for place in places]
