"""Frontier: which tasks of a plan are ready, deepest stage first, so that a data set is finished shape by shape."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Iterator

from b23d.pipeline.planning.nodes import LeafNode, Node, State
from b23d.pipeline.planning.plan import Plan


class Frontier:
    """Which nodes are ready: all they need is stored. Deepest stage first, then in order."""

    def __init__(self, plan: Plan) -> None:
        depth = {stage: index for index, stage in enumerate(plan.stages)}
        self._key = {(n.stage, n.recipe): (-depth[n.stage], order) for order, n in enumerate(plan.nodes.values())}
        self._waiting: dict[tuple[str, str], int] = {}
        self._below: dict[tuple[str, str], list[Node]] = defaultdict(list)
        self._ready: list[tuple[tuple[int, int], Node]] = []
        self._blocked: set[tuple[str, str]] = set()
        self._handed: set[tuple[str, str]] = set()  # given out behind what they wait for
        for node in plan.to_run():
            above = set(needed(node))
            self._waiting[node.stage, node.recipe] = len(above)
            for key in above:
                self._below[key].append(node)
            if not above:
                self._push(node)

    def pop(self) -> Node | None:
        return heapq.heappop(self._ready)[1] if self._ready else None

    def peek(self) -> Node | None:
        return self._ready[0][1] if self._ready else None

    def __len__(self) -> int:
        """How many are ready."""
        return len(self._ready)

    def followers(self, node: Node, before: set[tuple[str, str]]) -> list[Node]:
        """What is ready once all of `before` is done, `node` last."""
        return [
            below
            for below in self._below.get((node.stage, node.recipe), [])
            if (key := (below.stage, below.recipe)) not in before
            and key not in self._blocked
            and key not in self._handed
            and len(set(needed(below)) & before) == self._waiting[key]
        ]

    def hand_out(self, node: Node) -> None:
        """Give a node out before it is ready, behind what it waits for."""
        self._handed.add((node.stage, node.recipe))

    def hand_back(self, node: Node) -> None:
        """It is not to follow after all."""
        self._handed.discard((node.stage, node.recipe))

    def done(self, stage: str, address: str) -> None:
        for node in self._below.pop((stage, address), []):
            key = (node.stage, node.recipe)
            self._waiting[key] -= 1
            if self._waiting[key] == 0 and key not in self._blocked and key not in self._handed:
                self._push(node)

    def failed(self, stage: str, address: str) -> list[Node]:
        """Everything below, which is now blocked."""
        lost: list[Node] = []
        stack = self._below.pop((stage, address), [])
        while stack:
            node = stack.pop()
            key = (node.stage, node.recipe)
            if key not in self._blocked:
                self._blocked.add(key)
                lost.append(node)
                stack += self._below.pop(key, [])
        return lost

    def again(self, node: Node) -> None:
        """It was popped and has not been made: it is ready still."""
        self._push(node)

    def _push(self, node: Node) -> None:
        heapq.heappush(self._ready, (self._key[node.stage, node.recipe], node))


def needed(node: Node) -> Iterator[tuple[str, str]]:
    """Stored artifacts that must exist before this node can run, looking through transient stages."""
    for above in node.upstream():
        if isinstance(above, LeafNode) or above.state is State.CACHED:
            continue
        if above.state is State.TRANSIENT:
            yield from needed(above)
        else:
            yield above.stage, above.recipe
