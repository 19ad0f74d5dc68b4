"""Making a plan: which nodes a run wants, their addresses, and what state each is in."""

from __future__ import annotations

import gc
from collections.abc import Iterator

from b23d.pipeline.address import StageAddress, leaf_address, sha256
from b23d.pipeline.config import Config, feeding, gates, needed_for
from b23d.pipeline.contents import Contents
from b23d.pipeline.dataset import Shape
from b23d.pipeline.draws import Draw, draw_problems, draw_shots
from b23d.pipeline.errors import naming
from b23d.pipeline.index import Failure, Index
from b23d.pipeline.plan import MISSING, SHOTS, ByAddress, ByShape, LeafNode, Node, Plan, State
from b23d.pipeline.selection import EVERYTHING, Selection
from b23d.pipeline.stage import Input, Stage
from b23d.pipeline.store import Store


def make_plan(
    config: Config, shapes: list[Shape], store: Store, index: Index, selection: Selection = EVERYTHING
) -> Plan:
    """Plan a run over `shapes`; a selection narrows targets and stages (draws and addresses stay what they are).

    Raises SelectionError where it names what the run has not.
    """
    collecting = gc.isenabled()
    gc.disable()  # hundreds of thousands of live objects, no garbage: the collector would take a third of the time
    try:
        return _make_plan(config, shapes, store, index, selection)
    finally:
        if collecting:
            gc.enable()


def _make_plan(config: Config, shapes: list[Shape], store: Store, index: Index, selection: Selection) -> Plan:
    selection.check_stages(list(config.stages))
    quarantined = index.quarantined()
    planner = _Planner(config, store, index, quarantined)

    unusable = _plan_what_needs_no_shots(planner, shapes)
    draws = draw_shots(shapes, config.file.shots, unusable, planner.shot_leaves())
    targets = selection.targets(shapes, {failure.shape for failure in quarantined.values()})
    _plan_targets(planner, draws, targets)

    serving = [draw for draw in draws if not selection.narrows or any(t.name in targets for t in draw.targets)]
    wanted = targets | {shot.name for draw in serving for shot in draw.shots}
    by_shape = {key: node for key, node in planner.by_shape.items() if key[1] in wanted}
    nodes = {(node.stage, node.recipe): node for node in by_shape.values()}
    for node in nodes.values():
        planner.settle(node)
    by_shape, nodes = _only_selected(config, selection, targets, by_shape, nodes)

    problems = _problems(shapes, draws, planner)
    index.save_digests()
    stages = [name for name in config.stages if name in _stages(config, selection)]
    return Plan(stages, nodes, by_shape, draws, planner.contents, problems)


def _plan_what_needs_no_shots(planner: _Planner, shapes: list[Shape]) -> set[str]:
    """Nodes of every shape up to where shots come in; returns the names of the shapes that cannot be shots."""
    unusable = {shape.name for shape in shapes if shape.error}
    stages = [name for name in planner.config.stages if not planner.sees_shots[name]]
    for shape in shapes:
        for stage in stages:
            node = planner.node(stage, shape, None)
            if node is not None and (node.state is State.BLOCKED or _broken(node, planner.quarantined)):
                unusable.add(shape.name)
    return unusable


def _plan_targets(planner: _Planner, draws: list[Draw], targets: set[str]) -> None:
    stages = [name for name in planner.config.stages if planner.sees_shots[name]]
    for draw in draws:
        for stage in stages:
            for shape in draw.targets:
                if shape.name in targets:
                    planner.node(stage, shape, draw)


def _stages(config: Config, selection: Selection) -> set[str]:
    if selection.stages:
        return set(selection.stages)
    return needed_for(config, selection.until) if selection.until else set(config.stages)


def _only_selected(
    config: Config, selection: Selection, targets: set[str], by_shape: ByShape, nodes: ByAddress
) -> tuple[ByShape, ByAddress]:
    """What the selection asks for of settled nodes: some stages only, and to run again where it is forced."""
    stages = _stages(config, selection)
    chosen = {key: node for key, node in by_shape.items() if key[0] in stages}
    kept = {(node.stage, node.recipe): node for node in chosen.values()}
    if selection.force:
        forced = {(node.stage, node.recipe) for (_, shape, _), node in chosen.items() if shape in targets}
        for node in (kept[key] for key in kept if key in forced):
            if node.state is State.CACHED:
                node.state, node.forced = State.RUN, True
    if selection.stages:
        for node in kept.values():
            if node.state is State.RUN and (missing := _missing_above(node, kept)):
                node.state = State.BLOCKED
                node.reason = (
                    f"{node.shape}: {node.stage} needs {missing}, which is not stored; use --until {node.stage}"
                )
    return chosen, kept


def _missing_above(node: Node, kept: ByAddress) -> str | None:
    """A stage above that would have to run first and is not among those kept, looking through transient stages."""
    for above in node.upstream():
        if isinstance(above, LeafNode) or above.state is State.CACHED:
            continue
        if above.state is State.TRANSIENT:
            if missing := _missing_above(above, kept):
                return missing
        elif (above.stage, above.recipe) not in kept:
            return above.stage
    return None


def _problems(shapes: list[Shape], draws: list[Draw], planner: _Planner) -> list[Failure]:
    """What is wrong before anything runs: unusable shapes, draws without shots, files that cannot be read."""
    listed = [
        Failure("source", shape.name, MISSING, naming(shape.name, shape.error), True) for shape in shapes if shape.error
    ]
    leaves = planner.shot_leaves()
    told = draw_problems(shapes, planner.config.file.shots, draws, leaves)
    if leaves and not any(leaves & shape.leaves.keys() for shape in shapes):
        told[planner.config.dataset.unannotated()] = True
    undrawn = [
        Failure(SHOTS if mistaken else "draw", one.split(":")[0], MISSING, f"ValueError: {one}", True)
        for one, mistaken in told.items()
    ]
    lost = {shape: leaf.error for (shape, _), leaf in planner.leaves.items() if leaf.error}
    unread = [Failure("source", shape, MISSING, error, True) for shape, error in lost.items()]
    return [*listed, *undrawn, *unread]


class _Planner:
    def __init__(self, config: Config, store: Store, index: Index, quarantined: dict[str, Failure]) -> None:
        self.config, self.index, self.quarantined = config, index, quarantined
        self.present = {name: store.addresses(name) for name in config.stages}
        self.transient = frozenset(
            name for name in config.file.store.transient if name in config.stages and config.stages[name].checks is None
        )
        self.nodes: dict[tuple[str, str], Node] = {}
        self.by_shape: dict[tuple[str, str, int | None], Node] = {}
        self.leaves: dict[tuple[str, str], LeafNode] = {}
        self.of_shots: dict[tuple[str, str, int], list[Node | LeafNode] | None] = {}
        self.sources = {
            s: {i.name: feeding(config.file, i.upstream) for i in stage.inputs} for s, stage in config.stages.items()
        }
        self.shot_checks: dict[tuple[str, str, int], list[Node | None]] = {}
        self.gates = {
            name: {
                item.name: [g for g in gates(config.stages, self.sources[name][item.name], item.schema) if g != name]
                for item in stage.inputs
            }
            for name, stage in config.stages.items()
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
        self.contents = Contents(store, index, self.present, self.makers, self.fingerprints, self.transient)

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
        addresses = {argument: _recipe(value) for argument, value in inputs.items() if value is not None}
        address = self.makers[name]({**addresses, **self.fingerprints[name]})
        node = self.nodes.get((name, address))
        if node is None:
            shots = tuple(shot.name for shot in draw.shots) if key[2] is not None and draw else ()
            node = Node(name, shape.name, shape.category, address, address, inputs, shots=shots)
            node.after = tuple(self._checks(stage, shape, draw))
            self.nodes[name, address] = node
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
        if node.recipe in self.present[node.stage]:
            node.state = State.CACHED
            return
        key = self.contents.key(node)
        if key is not None and (at := self.contents.at(node.stage, key)) is not None:
            node.state, node.address = State.CACHED, at
            return
        node.behind = key is None
        for above in node.upstream():
            if isinstance(above, LeafNode):
                if above.error:
                    node.state, node.reason = State.BLOCKED, above.error
            elif above.state is State.BLOCKED:
                node.state, node.reason = State.BLOCKED, above.reason
            elif above.state is not State.CACHED and above.recipe in self.quarantined:
                node.state, node.reason = State.BLOCKED, self.quarantined[above.recipe].error
        if node.state is State.RUN and node.stage in self.transient:
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

    def _checks(self, stage: Stage, shape: Shape, draw: Draw | None) -> Iterator[Node]:
        """The nodes that check the leaves a stage takes, of the shape itself or of the draw's shots."""
        for item in stage.inputs:
            for gate in self.gates[stage.name][item.name]:
                if item.per_shot and draw is not None:
                    key = (gate, draw.category, draw.seed)
                    if key not in self.shot_checks:  # the same for thousands of targets
                        self.shot_checks[key] = [self.node(gate, shot, None) for shot in draw.shots]
                    found = self.shot_checks[key]
                else:
                    found = [] if item.per_shot else [self.node(gate, shape, None)]
                yield from (node for node in found if node is not None)

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


def _recipe(value: Node | LeafNode | list[Node | LeafNode]) -> str | list[str]:
    return [item.recipe for item in value] if isinstance(value, list) else value.recipe


def _broken(node: Node, quarantined: dict[str, Failure]) -> bool:
    failure = quarantined.get(node.recipe)
    return (failure is not None and failure.permanent) or any(
        isinstance(above, LeafNode) and above.error for above in node.upstream()
    )
