"""The plan: every artifact a run wants, by address, before anything is executed.

A node is one (stage, shape), or one (stage, shape, draw) for stages that see shots. Nodes with equal addresses are one:
a stage that asks for nothing but shots (it trains, say) has one node a draw, named after the first target.
Every stage is wanted except the transient ones, which are computed inside the tasks that need them.
"""

from __future__ import annotations

import gc
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum

from b23d.pipeline.address import StageAddress, leaf_address, sha256
from b23d.pipeline.config import Config, feeding
from b23d.pipeline.dataset import Leaf, Shape
from b23d.pipeline.draws import Draw, draw_shots
from b23d.pipeline.index import Failure, Index
from b23d.pipeline.stage import Input, Stage
from b23d.pipeline.store import Store

MISSING = "unreadable"  # address of a leaf whose file cannot be read


class State(Enum):
    RUN = "run"
    CACHED = "cached"
    BLOCKED = "blocked"
    TRANSIENT = "transient"


@dataclass(slots=True, eq=False)
class LeafNode:
    leaf: Leaf
    address: str
    error: str | None = None


@dataclass(slots=True, eq=False)
class Node:
    stage: str
    shape: str
    category: str
    address: str
    inputs: dict[str, Node | LeafNode | list[Node | LeafNode] | None]
    draws: list[int] = field(default_factory=list)
    """Draws this node serves; empty for stages that see no shots."""
    shots: tuple[str, ...] = ()
    state: State = State.RUN
    reason: str = ""
    """Why it is blocked."""

    def upstream(self) -> Iterator[Node | LeafNode]:
        for value in self.inputs.values():
            if isinstance(value, list):
                yield from value
            elif value is not None:
                yield value


@dataclass(frozen=True)
class Plan:
    stages: list[str]
    """In dataflow order."""
    nodes: dict[tuple[str, str], Node]
    """(stage, address) → node, upstream before downstream."""
    by_shape: dict[tuple[str, str, int | None], Node]
    """(stage, shape, draw) → node."""
    draws: list[Draw]
    problems: list[Failure]
    """What is wrong already: unusable shapes, classes with too few shots."""

    def count(self) -> dict[str, Counter[State]]:
        counts: dict[str, Counter[State]] = {stage: Counter() for stage in self.stages}
        for node in self.nodes.values():
            counts[node.stage][node.state] += 1
        return counts

    def to_run(self) -> list[Node]:
        return [node for node in self.nodes.values() if node.state is State.RUN]

    def inlined(self) -> Counter[str]:
        """How often each transient stage has to be computed inside the tasks to run."""
        needed = {(node.stage, node.address) for task in self.to_run() for node in _transient_above(task)}
        return Counter(stage for stage, _ in needed)


def make_plan(config: Config, shapes: list[Shape], store: Store, index: Index, limit: int | None = None) -> Plan:
    """Plan a run over `shapes`; `limit` keeps each class's first shapes as targets (draws stay what they are)."""
    collecting = gc.isenabled()
    gc.disable()  # hundreds of thousands of live objects, no garbage: the collector would take a third of the time
    try:
        return _make_plan(config, shapes, store, index, limit)
    finally:
        if collecting:
            gc.enable()


def _make_plan(config: Config, shapes: list[Shape], store: Store, index: Index, limit: int | None) -> Plan:
    quarantined = index.quarantined()
    planner = _Planner(config, store, index, quarantined)
    problems = [Failure("source", s.name, MISSING, s.error, True) for s in shapes if s.error]
    unusable = {s.name for s in shapes if s.error}
    upstream = [name for name in config.stages if not planner.sees_shots[name]]
    for shape in shapes:
        for stage in upstream:
            node = planner.node(stage, shape, None)
            if (node is not None and node.state is State.BLOCKED) or (node is not None and _broken(node, quarantined)):
                unusable.add(shape.name)
    draws = draw_shots(shapes, config.file.shots, unusable, planner.shot_leaves())
    kept = _kept(shapes, limit)
    for draw in draws:
        if draw.error:
            problems.append(
                Failure("draw", f"{draw.category} (draw {draw.seed})", MISSING, f"ValueError: {draw.error}", True)
            )
        for stage in config.stages:
            if planner.sees_shots[stage]:
                for shape in draw.targets:
                    if shape.name in kept:
                        planner.node(stage, shape, draw)
    wanted = kept | {shot.name for draw in draws for shot in draw.shots}
    by_shape = {key: node for key, node in planner.by_shape.items() if key[1] in wanted}
    nodes = {(node.stage, node.address): node for node in by_shape.values()}
    for node in nodes.values():
        planner.settle(node)
    lost = {shape: leaf.error for (shape, _), leaf in planner.leaves.items() if leaf.error}
    problems += [Failure("source", shape, MISSING, error, True) for shape, error in lost.items()]
    index.save_digests()
    return Plan(list(config.stages), nodes, by_shape, draws, problems)


class _Planner:
    def __init__(self, config: Config, store: Store, index: Index, quarantined: dict[str, Failure]) -> None:
        self.config, self.index, self.quarantined = config, index, quarantined
        self.present = {name: store.addresses(name) for name in config.stages}
        self.nodes: dict[tuple[str, str], Node] = {}
        self.by_shape: dict[tuple[str, str, int | None], Node] = {}
        self.leaves: dict[tuple[str, str], LeafNode] = {}
        self.of_shots: dict[tuple[str, str, int], list[Node | LeafNode] | None] = {}
        self.sources = {
            s: {i.name: feeding(config.file, i.upstream) for i in stage.inputs} for s, stage in config.stages.items()
        }
        self.sees_shots: dict[str, bool] = {}
        self.makers: dict[str, StageAddress] = {}
        self.fingerprints: dict[str, dict[str, str]] = {}
        for name, stage in config.stages.items():
            params = config.params[name]
            upstream_sees = any(self.sees_shots.get(source, False) for source in self.sources[name].values())
            self.sees_shots[name] = upstream_sees or any(item.per_shot for item in stage.inputs)
            self.makers[name] = StageAddress(name, stage.version, params.hashed())
            self.fingerprints[name] = dict(stage.fingerprint(params)) if stage.fingerprint else {}

    def node(self, name: str, shape: Shape, draw: Draw | None) -> Node | None:
        """The node of (stage, shape, draw); None where the shape lacks a leaf that the stage needs."""
        key = (name, shape.name, draw.seed if draw and self.sees_shots[name] else None)
        if key in self.by_shape:
            return self.by_shape[key]
        stage = self.config.stages[name]
        inputs: dict[str, Node | LeafNode | list[Node | LeafNode] | None] = {}
        for item in stage.inputs:
            value = self._input(stage, item, shape, draw)
            if value is None and not item.optional:
                return None
            inputs[item.name] = value
        addresses = {argument: _address(value) for argument, value in inputs.items() if value is not None}
        address = self.makers[name]({**addresses, **self.fingerprints[name]})
        node = self.nodes.get((name, address))
        if node is None:
            shots = tuple(shot.name for shot in draw.shots) if key[2] is not None and draw else ()
            node = self.nodes[name, address] = Node(name, shape.name, shape.category, address, inputs, shots=shots)
            if shape.error and not all(item.per_shot for item in stage.inputs):
                node.state, node.reason = State.BLOCKED, shape.error
        if key[2] is not None and key[2] not in node.draws:
            node.draws.append(key[2])
        self.by_shape[key] = node
        return node

    def shot_leaves(self) -> set[str]:
        """The leaves that this run's stages must have of every shot: what makes a shape an annotated one."""
        asked = [
            (name, i)
            for name, stage in self.config.stages.items()
            for i in stage.inputs
            if i.per_shot and not i.optional
        ]
        return {self.sources[name][item.name] for name, item in asked} - self.config.stages.keys()

    def settle(self, node: Node) -> None:
        """Decide a node's state; upstream nodes are settled before."""
        if node.address in self.present[node.stage]:
            node.state = State.CACHED
            return
        for above in node.upstream():
            if isinstance(above, LeafNode):
                if above.error:
                    node.state, node.reason = State.BLOCKED, above.error
            elif above.state is State.BLOCKED:
                node.state, node.reason = State.BLOCKED, above.reason
            elif above.state is not State.CACHED and above.address in self.quarantined:
                node.state, node.reason = State.BLOCKED, self.quarantined[above.address].error
        if node.state is State.RUN and node.stage in self.config.file.store.transient:
            node.state = State.TRANSIENT

    def _input(
        self, stage: Stage, item: Input, shape: Shape, draw: Draw | None
    ) -> Node | LeafNode | list[Node | LeafNode] | None:
        source = self.sources[stage.name][item.name]
        if not item.per_shot:
            return self._upstream(source, shape, draw)
        if draw is None:
            return None
        key = (source, draw.category, draw.seed)
        if key not in self.of_shots:  # the same for thousands of targets
            found = [self._upstream(source, shot, None) for shot in draw.shots]
            self.of_shots[key] = (
                None if any(value is None for value in found) else [value for value in found if value is not None]
            )
        return self.of_shots[key]

    def _upstream(self, source: str, shape: Shape, draw: Draw | None) -> Node | LeafNode | None:
        if source in self.config.stages:
            return self.node(source, shape, draw)
        return self._leaf(source, shape)

    def _leaf(self, name: str, shape: Shape) -> LeafNode | None:
        leaf = shape.leaves.get(name)
        if leaf is None:
            return None
        key = (shape.name, name)
        if key not in self.leaves:
            try:
                files = {file: self.index.file_digest(path) for file, path in leaf.files.items()}
                self.leaves[key] = LeafNode(leaf, leaf_address(leaf.values, files))
            except (OSError, ValueError) as error:
                self.leaves[key] = LeafNode(
                    leaf, sha256(f"{MISSING}:{shape.name}"), f"{type(error).__name__}: {shape.name}: {error}"
                )
        return self.leaves[key]


def _address(value: Node | LeafNode | list[Node | LeafNode]) -> str | list[str]:
    return [item.address for item in value] if isinstance(value, list) else value.address


def _broken(node: Node, quarantined: dict[str, Failure]) -> bool:
    failure = quarantined.get(node.address)
    return (failure is not None and failure.permanent) or any(
        isinstance(above, LeafNode) and above.error for above in node.upstream()
    )


def _transient_above(node: Node) -> Iterator[Node]:
    for above in node.upstream():
        if isinstance(above, Node) and above.state is State.TRANSIENT:
            yield above
            yield from _transient_above(above)


def _kept(shapes: list[Shape], limit: int | None) -> set[str]:
    if limit is None:
        return {shape.name for shape in shapes}
    by_class: dict[str, list[str]] = defaultdict(list)
    for shape in shapes:
        by_class[shape.category].append(shape.name)
    return {name for names in by_class.values() for name in names[:limit]}
