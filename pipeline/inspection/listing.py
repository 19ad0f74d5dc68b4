"""What a run has: its shapes, or one stage's artifacts, with their states and sizes."""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import asdict, dataclass
from typing import Any

from b23d.pipeline.errors import SelectionError
from b23d.pipeline.planning.hinting import hint
from b23d.pipeline.planning.nodes import Node, State
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.planning.selection import EVERYTHING, Selection
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import feeding


@dataclass(frozen=True)
class ListedShape:
    """One shape of a run."""

    shape: str
    state: str
    """done, waiting, failed or blocked: the worst of its artifacts."""
    annotated: bool
    shot: list[int]
    """Draws in which it is a shot."""
    stages: dict[str, str]
    """Stage → state."""
    bytes: int
    error: str = ""
    lack: str = ""
    """Why nothing is predicted of its class, if so."""

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


@dataclass(frozen=True)
class ListedArtifact:
    """One artifact of a stage."""

    shape: str
    draws: list[int]
    """Empty where the stage sees no shots."""
    state: str
    address: str
    bytes: int
    seconds: float
    error: str = ""

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


WORDS = {State.CACHED: "done", State.RUN: "waiting", State.BLOCKED: "blocked", State.TRANSIENT: "inline"}
WORST = ["failed", "blocked", "waiting", "done", "inline"]


def list_shapes(run: Run, selection: Selection = EVERYTHING) -> list[ListedShape]:
    """Every selected shape, in order. Nothing is executed, no artifact opened."""
    plan, chosen = run.plan(), selection.targets(run.shapes)
    sizes = {stage: {address: size for address, _, size, _ in run.index.history(stage)} for stage in plan.stages}
    errors = _errors(run, plan)
    shots: dict[str, list[int]] = defaultdict(list)
    for draw in plan.draws:
        for shot in draw.shots:
            shots[shot.name].append(draw.seed)
    nodes: dict[str, dict[str, list[Node]]] = defaultdict(lambda: defaultdict(list))
    for (stage, name, _), node in plan.by_shape.items():
        nodes[name][stage].append(node)
    lacks = {category: plan.no_shots(category) for category in {shape.category for shape in run.shapes}}
    listed = []
    for shape in run.shapes:
        if shape.name in chosen:
            of = nodes[shape.name]
            states = {stage: _worst(_state(node, errors) for node in made) for stage, made in of.items()}
            size = sum(sizes[node.stage].get(node.address, 0) for node in _distinct(of) if node.state is State.CACHED)
            error = shape.error or next((errors[n.address] for n in _distinct(of) if n.address in errors), "")
            worst = "failed" if shape.error else _worst(states.values())
            annotated = "keypoints" in shape.leaves
            lack = "" if shape.error else lacks[shape.category]
            listed.append(ListedShape(shape.name, worst, annotated, shots[shape.name], states, size, error, lack))
    return listed


def list_artifacts(run: Run, stage: str, selection: Selection = EVERYTHING) -> list[ListedArtifact]:
    """Every artifact of a stage that the selected shapes have. Raises SelectionError where there is no such stage."""
    name = feeding(run.config.file, stage)
    if name not in run.config.stages:
        near = hint(stage, list(run.config.stages), "check the name")
        raise SelectionError(f"stage: expected one of {', '.join(run.config.stages)}, got {stage!r}; {near}")
    plan, chosen = run.plan(), selection.targets(run.shapes)
    known = {address: (seconds, size) for address, seconds, size, _ in run.index.history(name)}
    errors = _errors(run, plan)
    found: dict[tuple[str, str], ListedArtifact] = {}
    for (of, shape, draw), node in plan.by_shape.items():
        if of != name or shape not in chosen:
            continue
        row = found.get((shape, node.address))
        if row is None:
            seconds, size = known.get(node.address, (0.0, 0)) if node.state is State.CACHED else (0.0, 0)
            state, error = _state(node, errors), errors.get(node.address, node.reason)
            row = found[shape, node.address] = ListedArtifact(shape, [], state, node.address, size, seconds, error)
        if draw is not None:
            row.draws.append(draw)
    return sorted(found.values(), key=lambda row: (row.shape, row.draws))


def _errors(run: Run, plan: Plan) -> dict[str, str]:
    """Address → error of the plan's artifacts that failed before."""
    addresses = {node.address for node in plan.nodes.values()}
    return {a: failure.error for a, failure in run.index.quarantined().items() if a in addresses}


def _state(node: Node, errors: dict[str, str]) -> str:
    if node.state in (State.RUN, State.BLOCKED) and node.address in errors:
        return "failed"
    return WORDS[node.state]


def _worst(states: Any) -> str:
    counted = Counter(states)
    return next((state for state in WORST if counted[state]), "waiting")


def _distinct(of: dict[str, list[Node]]) -> list[Node]:
    return list({(node.stage, node.address): node for made in of.values() for node in made}.values())
