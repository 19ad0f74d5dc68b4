"""The planner: the node of every (stage, shape, draw), its address, and what state it is in."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

from b23d.pipeline.address import StageAddress, leaf_address, sha256
from b23d.pipeline.dataset import Shape
from b23d.pipeline.errors import unreadable
from b23d.pipeline.planning.contents import Contents
from b23d.pipeline.planning.draws import Draw, draw_examples
from b23d.pipeline.planning.nodes import MISSING, LeafNode, Node, State
from b23d.pipeline.runfile.config import Config, feeding, gates
from b23d.pipeline.stage import Input, Stage
from b23d.pipeline.storage.index import Index
from b23d.pipeline.store import Store

Accepting = Mapping[str, tuple[int, ...]]
"""Stage → older versions that are taken for the installed one."""


class Planner:
    def __init__(self, config: Config, store: Store, index: Index, accepting: Accepting) -> None:
        self.config, self.index, self.quarantined = config, index, index.quarantined()
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
        self.examples: dict[str, tuple[Shape, ...]] = {}
        """Class → its examples; known before the first node that asks for them."""
        self.shot_checks: dict[tuple[str, str, int], list[Node | None]] = {}
        self.gates = {
            name: [
                (item, gate)
                for item in stage.inputs
                for gate in gates(config.stages, self.sources[name][item.name], item.schema)
                if gate != name and not item.example  # a check waits for how shapes stand, which examples tell
            ]
            for name, stage in config.stages.items()
        }
        self.of_draws: dict[tuple[str, str, int], Node | None] = {}
        """(stage, class, draw) → the one node of a stage that asks for nothing but shots."""
        self.sees_shots: dict[str, bool] = {}
        self.only_shots = {
            name: bool(stage.inputs) and all(item.per_shot for item in stage.inputs)
            for name, stage in config.stages.items()
        }
        self.makers: dict[str, StageAddress] = {}
        self.fingerprints: dict[str, dict[str, str]] = {}
        for name, stage in config.stages.items():
            params = config.params[name]
            upstream_sees = any(self.sees_shots.get(source, False) for source in self.sources[name].values())
            self.sees_shots[name] = upstream_sees or any(item.per_shot for item in stage.inputs)
            self.makers[name] = StageAddress(name, stage.version, params.hashed())
            self.fingerprints[name] = dict(stage.fingerprint(params)) if stage.fingerprint else {}
        accepted = {
            name: {v: StageAddress(name, v, config.params[name].hashed()) for v in taken}
            for name, taken in accepting.items()
            if name in config.stages
        }
        self.contents = Contents(store, index, self.present, self.makers, self.fingerprints, self.transient, accepted)

    def node(self, name: str, shape: Shape, draw: Draw | None) -> Node | None:
        """The node of (stage, shape, draw); None where the shape lacks a leaf that the stage needs."""
        key = (name, shape.name, draw.seed if draw and self.sees_shots[name] else None)
        if (known := self.by_shape.get(key)) is not None:
            return known
        stage = self.config.stages[name]
        if draw is None or not self.only_shots[name]:
            return self._node(stage, shape, draw, key)
        whole = (name, draw.category, draw.seed)
        if whole not in self.of_draws:  # the same for thousands of targets
            self.of_draws[whole] = self._node(stage, shape, draw, key)
        if (node := self.of_draws[whole]) is not None:
            self.by_shape[key] = node
        return node

    def _node(self, stage: Stage, shape: Shape, draw: Draw | None, key: tuple[str, str, int | None]) -> Node | None:
        name = stage.name
        inputs: dict[str, Node | LeafNode | list[Node | LeafNode] | None] = {}
        addresses: dict[str, str | list[str]] = dict(self.fingerprints[name])
        for item in stage.inputs:
            value = self._input(stage, item, shape, draw)
            if value is None:
                if not item.optional:
                    return None
            else:
                addresses[item.name] = [v.recipe for v in value] if isinstance(value, list) else value.recipe
            inputs[item.name] = value
        address = self.makers[name](addresses)
        node = self.nodes.get((name, address))
        if node is None:
            seen = draw.shots if key[2] is not None and draw else ()
            if not seen and any(item.example for item in stage.inputs):
                seen = self.examples.get(shape.category, ())
            shots = tuple(shot.name for shot in seen)
            node = Node(name, shape.name, shape.category, address, address, inputs, shots=shots)
            if self.gates[name]:
                node.after = tuple(self._checks(stage, shape, draw))
            self.nodes[name, address] = node
            if shape.error and any(not item.per_shot and not item.example for item in stage.inputs):
                node.state, node.reason = State.BLOCKED, shape.error
        if key[2] is not None and key[2] not in node.draws:
            node.draws.append(key[2])
        self.by_shape[key] = node
        return node

    def shot_leaves(self, stages: Collection[str] | None = None) -> set[str]:
        """The leaves that these stages, or all of this run's, must have of every shot: what makes a shape an annotated
        one."""
        asked = [
            (name, i)
            for name, stage in self.config.stages.items()
            for i in stage.inputs
            if i.per_shot and not i.optional and (stages is None or name in stages)
        ]
        return {self.sources[name][item.name] for name, item in asked} - self.config.stages.keys()

    def choose_examples(self, shapes: Sequence[Shape]) -> None:
        """Choose every class's examples, where a stage of the run asks for them: shapes whose leaves can be read."""
        asked = {
            self.sources[name][item.name]
            for name, stage in self.config.stages.items()
            for item in stage.inputs
            if item.example
        }
        leaves = asked - self.config.stages.keys()
        if asked:
            having = [shape for shape in shapes if leaves <= shape.leaves.keys()]
            lost = {s.name for s in having if s.error or any((x := self._leaf(n, s)) and x.error for n in leaves)}
            self.examples = draw_examples(having, self.config.file.shots, lost, leaves)

    def settle(self, node: Node) -> None:
        """Decide a node's state; upstream nodes are settled before."""
        if node.recipe in self.present[node.stage]:
            node.state = State.CACHED
            return
        if self.contents.accepted:
            node.accepted = tuple(sorted({word for above in node.upstream() for word in above.accepted}))
        if (at := self.contents.found(node)) is not None:
            node.state, node.address = State.CACHED, at
            return
        node.behind = node.key is None
        for above in node.upstream():
            if isinstance(above, LeafNode):
                if above.error:
                    node.state, node.reason = State.BLOCKED, above.error
            elif above.state is State.CACHED:
                continue
            elif above.state is State.BLOCKED:
                node.state, node.reason = State.BLOCKED, above.reason
            elif above.recipe in self.quarantined:
                node.state, node.reason = State.BLOCKED, self.quarantined[above.recipe].error
        if node.state is State.RUN and node.stage in self.transient:
            node.state = State.TRANSIENT

    def _input(
        self, stage: Stage, item: Input, shape: Shape, draw: Draw | None
    ) -> Node | LeafNode | list[Node | LeafNode] | None:
        source = self.sources[stage.name][item.name]
        if item.example:
            found = [self._upstream(source, each, None) for each in self.examples.get(shape.category, ())]
            return [each for each in found if each is not None] or None
        if not item.per_shot:
            return self._upstream(source, shape, draw)
        if draw is None:
            return None
        key = (source, draw.category, draw.seed)
        if key not in self.of_shots:  # the same for thousands of targets
            of_shots = [self._upstream(source, shot, None) for shot in draw.shots]
            self.of_shots[key] = (
                None if any(value is None for value in of_shots) else [value for value in of_shots if value is not None]
            )
        return self.of_shots[key]

    def _checks(self, stage: Stage, shape: Shape, draw: Draw | None) -> Iterator[Node]:
        """The nodes that check the leaves a stage takes, of the shape itself or of the draw's shots."""
        for item, gate in self.gates[stage.name]:
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
                files = {file: self._digest(path) for file, path in leaf.files.items()}
                self.leaves[key] = LeafNode(leaf, leaf_address(leaf.values, files))
            except (OSError, ValueError) as error:
                self.leaves[key] = LeafNode(
                    leaf, sha256(f"{MISSING}:{shape.name}"), f"{type(error).__name__}: {shape.name}: {error}"
                )
        return self.leaves[key]

    def _digest(self, path: Path) -> str:
        try:
            return self.index.file_digest(path)
        except OSError as error:
            raise unreadable(path, error) from error
