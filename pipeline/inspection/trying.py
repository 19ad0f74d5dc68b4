"""One task alone: run a stage in this process on stored inputs, store nothing, and compare with what is stored."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from b23d.pipeline.errors import ArtifactNotFoundError
from b23d.pipeline.inspection.comparing import Differing, differences
from b23d.pipeline.planning.nodes import LeafNode, Node, State
from b23d.pipeline.run import Run
from b23d.schemas.artifact import Artifact

Call = Callable[..., Artifact]


@dataclass(frozen=True)
class Trial:
    """What one stage gave, beside what is stored."""

    stage: str
    shape: str
    address: str
    artifact: Artifact
    seconds: float
    """Wall clock of the stage's function alone."""
    made: list[str] = field(default_factory=list)
    """`<stage> of <shape>` of inputs that were not stored and were made for this trial, too."""
    stored: bool = False
    """Whether the very same address is in the store, so that there was something to compare with."""
    differences: list[Differing] = field(default_factory=list)


def attempt(run: Run, shape: str, stage: str, draw: int | None = None, call: Call | None = None) -> Trial:
    """Run the stage of one shape here. `call(function, **arguments)` may wrap it: a debugger, a profiler.

    Inputs that are not stored are made in memory first. Nothing is written.
    Raises KeyError where the run has no such shape or stage, and what the stage raises.
    """
    node = run.node(shape, stage, draw)
    made: list[str] = []
    arguments = _arguments(run, node, made, {})
    function = run.config.stages[node.stage].function
    started = time.perf_counter()
    params = run.config.params[node.stage]
    artifact = call(function, **arguments, params=params) if call else function(**arguments, params=params)
    seconds = time.perf_counter() - started
    try:
        before = run.store.read(node.stage, node.address, run.config.stages[node.stage].gives)
    except ArtifactNotFoundError:
        return Trial(node.stage, node.shape, node.address, artifact, seconds, made)
    found = differences(artifact, before)
    return Trial(node.stage, node.shape, node.address, artifact, seconds, made, True, found)


def make(run: Run, node: Node) -> Artifact:
    """What a node's stage gives, made here; nothing is stored."""
    arguments = _arguments(run, node, [], {})
    return run.config.stages[node.stage].function(**arguments, params=run.config.params[node.stage])


def _arguments(run: Run, node: Node, made: list[str], known: dict[str, Artifact]) -> dict[str, Any]:
    arguments: dict[str, Any] = {}
    for name, value in node.inputs.items():
        if isinstance(value, list):
            arguments[name] = [_input(run, item, made, known) for item in value]
        else:
            arguments[name] = None if value is None else _input(run, value, made, known)
    return arguments


def _input(run: Run, item: Node | LeafNode, made: list[str], known: dict[str, Artifact]) -> Artifact:
    if isinstance(item, LeafNode):
        return item.leaf.read()
    if item.state is State.CACHED:
        return run.store.read(item.stage, item.address, run.config.stages[item.stage].gives)
    if item.address not in known:
        arguments = _arguments(run, item, made, known)
        known[item.address] = run.config.stages[item.stage].function(**arguments, params=run.config.params[item.stage])
        made.append(f"{item.stage} of {item.shape}")
    return known[item.address]
