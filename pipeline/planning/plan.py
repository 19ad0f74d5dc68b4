"""The plan: every artifact a run wants, by address, before anything is executed.

Every stage is wanted except the transient ones, which are computed inside the tasks that need them.
"""

from __future__ import annotations

import html
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

from b23d.pipeline.planning.contents import Contents
from b23d.pipeline.planning.draws import Draw
from b23d.pipeline.planning.nodes import Node, State
from b23d.pipeline.storage.index import Failure

ByShape = dict[tuple[str, str, int | None], Node]
ByAddress = dict[tuple[str, str], Node]


@dataclass(frozen=True)
class Plan:
    stages: list[str]
    """In dataflow order."""
    nodes: ByAddress
    """(stage, recipe) → node, upstream before downstream."""
    by_shape: ByShape
    """(stage, shape, draw) → node."""
    draws: list[Draw]
    contents: Contents
    """What is known of what stored artifacts gave."""
    problems: list[Failure]
    """What is wrong already: unusable shapes, classes with too few shots."""
    unannotated: bool = False
    """The stages ask for annotations and no shape has any, so that nothing can be predicted."""
    unannotated_classes: dict[str, str] = field(default_factory=dict)
    """Class of which the stages ask for annotations that none of its shapes has → what follows."""

    def no_shots(self, category: str) -> str:
        """Why nothing of a class can be predicted, with its name; "" where something may be."""
        if lack := self.unannotated_classes.get(category):
            return f"class {category}: {lack}"
        errors = [draw.error for draw in self.draws if draw.category == category]
        return (all(errors) and next(iter(errors), "")) or ""

    def __repr__(self) -> str:
        return f"<plan: {'; '.join(f'{stage} {self._states(stage)}' for stage in self.stages)}>"

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><td>{stage}</td><td>{self._states(stage)}</td></tr>" for stage in self.stages)
        problems = "".join(f"<li>{html.escape(problem.error)}</li>" for problem in self.problems)
        return f"<table>{rows}</table>" + (f"<ul>{problems}</ul>" if problems else "")

    def _states(self, stage: str) -> str:
        """How many nodes of a stage are in which state, in words."""
        counts = self.count()[stage]
        words = {State.RUN: "to run", State.CACHED: "cached", State.BLOCKED: "blocked", State.TRANSIENT: "inline"}
        return ", ".join(f"{counts[state]} {word}" for state, word in words.items() if counts[state]) or "nothing"

    def count(self) -> dict[str, Counter[State]]:
        counts: dict[str, Counter[State]] = {stage: Counter() for stage in self.stages}
        for node in self.nodes.values():
            counts[node.stage][node.state] += 1
        return counts

    def to_run(self) -> list[Node]:
        return [node for node in self.nodes.values() if node.state is State.RUN]

    def behind(self) -> int:
        """How many of those to run may be spared: what they need is to be made first, and may turn out to be known."""
        return sum(node.behind for node in self.to_run())

    def inlined(self) -> Counter[str]:
        """How often each transient stage has to be computed inside the tasks to run."""
        needed = {(node.stage, node.recipe) for task in self.to_run() for node in _transient_above(task)}
        return Counter(stage for stage, _ in needed)

    def reached(self) -> set[tuple[str, str]]:
        """(stage, address) of all that this plan has, or will make."""
        return {(node.stage, address) for node in self.nodes.values() for address in (node.recipe, node.address)}


def _transient_above(node: Node) -> Iterator[Node]:
    for above in node.upstream():
        if isinstance(above, Node) and above.state is State.TRANSIENT:
            yield above
            yield from _transient_above(above)
