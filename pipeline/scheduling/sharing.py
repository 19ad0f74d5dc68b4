"""Sharing work with other runs on the same store: what one of them makes just now is not made here as well."""

from __future__ import annotations

import time
from collections.abc import Iterable

from b23d.pipeline.planning.nodes import Node
from b23d.pipeline.scheduling.frontier import needed
from b23d.pipeline.storage.claims import Claims
from b23d.pipeline.store import Store

POLL = 0.2  # seconds between two looks at what others make
PATIENCE = 5.0  # seconds to wait for more of it once some is there: to plan again costs time, too


class Sharing:
    """The artifacts that one execution leaves to others, or they to it. `lease`: this execution's."""

    def __init__(self, store: Store, lease: str) -> None:
        self._store, self._claims = store, Claims(store, lease)
        self._left: set[tuple[str, str]] = set()
        self.given = 0
        """How many artifacts others have made meanwhile."""

    def ours(self, nodes: Iterable[Node]) -> list[Node]:
        """Of nodes in the order to make them in, those that nobody else makes or has just made, and that need none
        of those."""
        mine: list[Node] = []
        for node in nodes:
            key = (node.stage, node.recipe)
            if not self._left.isdisjoint(needed(node)) or not self._claims.take(*key):
                self._left.add(key)
            elif self._store.local and not node.forced and self._store.has(*key):
                self._claims.release(*key)
                self._left.add(key)
            else:
                mine.append(node)
        return mine

    def release(self, stage: str, recipe: str) -> None:
        """It is made, or failed."""
        self._claims.release(stage, recipe)

    def wait(self) -> bool:
        """Until some of what is left to others is there, or nobody makes it any more. False: nothing is left to
        others."""
        left, self._left = self._left, set()
        waiting, patience = set(left), 0.0
        while waiting and patience < PATIENCE:
            settled = {key for key in waiting if self._store.has(*key) or not self._claims.taken_elsewhere(*key)}
            waiting -= settled
            if waiting:
                patience += POLL if len(waiting) < len(left) else 0.0
                time.sleep(POLL)
        self.given += sum(self._store.has(*key) for key in left)
        return bool(left)

    def end(self) -> None:
        self._claims.release_all()
