"""Lineage downwards: all that was, or would be, made from one artifact or one leaf of a shape, down to the scores."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field

from b23d.pipeline.inspection.explain import BYTES, explain_node
from b23d.pipeline.planning.nodes import LeafNode, Node, State
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.records.history import Record, reached_by, records
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import feeding
from b23d.pipeline.stage import upstream_of


@dataclass(frozen=True)
class Descent:
    """What hangs on one artifact or leaf."""

    stage: str
    shape: str
    below: dict[str, list[Node]]
    """Stage → nodes of this run's plan that were, or would be, made from it; in dataflow order."""
    as_shot: set[str]
    """Names of the shapes that it reaches as one of their shots, not as itself."""
    recorded: list[Record] = field(default_factory=list)
    """Executions that had any of it, oldest first."""


def descent(run: Run, shape: str, stage: str, draw: int | None = None) -> Descent:
    """Follow one artifact (`stage` of `shape`), or a leaf (`source`, `keypoints`), down to all that it touched.

    Raises KeyError where the run has no such shape, or it neither such a stage nor such a leaf.
    """
    plan = run.plan()
    known = feeding(run.config.file, stage) in run.config.stages
    reached = _start(run, plan, shape, stage, draw, known)
    below: dict[str, list[Node]] = defaultdict(list)
    for node in plan.nodes.values():  # upstream before downstream
        if id(node) not in reached and any(id(above) in reached for above in node.upstream()):
            reached.add(id(node))
            below[node.stage].append(node)
    found = {name: below[name] for name in plan.stages if below[name]}
    others = {node.shape for nodes in found.values() for node in nodes} - {shape}
    touched = {(node.stage, node.address) for nodes in found.values() for node in nodes}
    recorded = [record for record in records(run.store) if touched & reached_by(run.store, record)]
    return Descent(stage, shape, found, others, recorded)


def _start(run: Run, plan: Plan, shape: str, stage: str, draw: int | None, known: bool) -> set[int]:
    if known:
        node = run.node(shape, stage, draw)
        return {id(item) for item in plan.nodes.values() if (item.stage, item.recipe) == (node.stage, node.recipe)}
    found = {id(leaf) for node in plan.nodes.values() for leaf in _leaves(run, node, shape, stage)}
    if not found:
        raise KeyError(
            f"stage: expected a stage or leaf that {shape} has, got {stage!r}; "
            f"stages are {', '.join(plan.stages)}; leaves are what the data set gives, as source and keypoints"
        )
    return found


def _leaves(run: Run, node: Node, shape: str, name: str) -> Iterator[LeafNode]:
    """The leaf `name` of `shape` among a node's inputs, its own or a shot's."""
    for argument, value in node.inputs.items():
        if feeding(run.config.file, upstream_of(argument)) != name:
            continue
        if isinstance(value, LeafNode) and node.shape == shape:
            yield value
        elif isinstance(value, list):
            shots = zip(node.shots, value, strict=False)
            yield from (leaf for shot, leaf in shots if shot == shape and isinstance(leaf, LeafNode))


def reasons(run: Run, plan: Plan) -> tuple[Counter[str], int]:
    """Why tasks are to run: the first difference from what is stored, counted over the tasks that wait for no other;
    and how many wait behind those."""
    found: Counter[str] = Counter()
    behind = 0
    for node in plan.to_run():
        if any(_waits(above) for above in node.upstream()):
            behind += 1
            continue
        told = explain_node(run, node)
        if told.nearest is None:
            found[f"{node.stage} was never made"] += 1
        elif told.nearest == node.address or not told.differences:
            found[f"{node.stage} is to be made again"] += 1
        else:
            first = told.differences[0]
            found[f"{first.field} changed" if BYTES in first.field else f"{first} changed"] += 1
    return found, behind


def _waits(above: Node | LeafNode) -> bool:
    if isinstance(above, LeafNode):
        return False
    return above.state is State.RUN or (above.state is State.TRANSIENT and any(map(_waits, above.upstream())))
