"""Batches: which tasks go to a worker together, because handing out each alone would cost more than doing it.

What follows a task and waits for nothing else goes with it: the artifact is at hand there. Short tasks go together up
to `SHORT` seconds. Each is still stored, counted and resumed by itself.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable

from b23d.pipeline.planning.nodes import Node
from b23d.pipeline.scheduling.frontier import Frontier
from b23d.pipeline.scheduling.tasks import Outcome

SHORT = 0.1  # seconds of work in a batch: a hundred times what handing it out costs
LONG = 10.0  # seconds after which a batch is heard of, so that a run never seems to stand still
UNKNOWN = 0.5  # seconds a task of a stage that was never seen is taken for
MOST = 64


class Batches:
    """Ready nodes of a frontier, in batches. Nodes of one batch are of one lane: they need the same resources."""

    def __init__(
        self, frontier: Frontier, lane: Callable[[str], object], alone: Callable[[Node], bool] = lambda node: False
    ) -> None:
        """`alone`: which nodes follow nothing, because they may turn out not to be needed."""
        self._frontier, self._lane, self._alone = frontier, lane, alone
        self._seconds: dict[str, float] = defaultdict(lambda: UNKNOWN)

    def next(self, slots: int) -> list[Node]:
        """The next batch, in the order to do it in; empty: nothing is ready. `slots` workers share what is ready."""
        share = min(MOST, len(self._frontier) // (2 * slots))
        batch: list[Node] = []
        seconds = 0.0
        while (node := self._frontier.peek()) is not None:
            if batch and (self._lane(node.stage) != self._lane(batch[0].stage) or seconds >= SHORT or share <= 0):
                break
            self._frontier.pop()
            chain = self._chain(node, alone=share <= 1)
            batch += chain
            share -= 1
            seconds += sum(self._seconds[member.stage] for member in chain)
        return batch

    def _chain(self, first: Node, alone: bool) -> list[Node]:
        """A node and what can follow it at once. `alone`: other workers wait, so that only one node follows another."""
        chain, before = [first], {(first.stage, first.recipe)}
        seconds = self._seconds[first.stage]
        for node in chain:  # grows meanwhile
            following = [
                n
                for n in self._frontier.followers(node, before)
                if self._lane(n.stage) == self._lane(first.stage) and not self._alone(n)
            ]
            if alone and len(following) > 1:
                continue
            for follower in following:
                if seconds < LONG:
                    self._frontier.hand_out(follower)
                    chain.append(follower)
                    before.add((follower.stage, follower.recipe))
                    seconds += self._seconds[follower.stage]
        return chain

    def heard(self, outcome: Outcome) -> None:
        """How long a stage takes, from what it took."""
        known, took = self._seconds.get(outcome.stage), outcome.seconds + outcome.overhead
        self._seconds[outcome.stage] = took if known is None else 0.9 * known + 0.1 * took
