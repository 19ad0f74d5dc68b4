"""Nodes of a plan: one (stage, shape), or one (stage, shape, draw) for stages that see shots.

Nodes with equal addresses are one: a stage that asks for nothing but shots (it learns, say) has one node a draw, named
after the first target.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum

from b23d.pipeline.dataset import Leaf

SHOTS = "shots"  # stage of a problem with the run's shots that no other shape mends
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

    @property
    def accepted(self) -> tuple[str, ...]:
        """Nothing of a leaf is taken on anybody's word."""
        return ()

    @property
    def recipe(self) -> str:
        """A leaf is what it is: its address says it all."""
        return self.address


@dataclass(slots=True, eq=False)
class Node:
    stage: str
    shape: str
    category: str
    recipe: str
    """Its address by how it is made."""
    address: str
    """Where it is, or will be, stored: its recipe's address, or that of an artifact that is known to hold the same."""
    inputs: dict[str, Node | LeafNode | list[Node | LeafNode] | None]
    draws: list[int] = field(default_factory=list)
    """Draws this node serves; empty for stages that see no shots."""
    shots: tuple[str, ...] = ()
    after: tuple[Node, ...] = ()
    """Checks of the leaves it takes: it waits for them; they give it nothing, and its address does not know them."""
    state: State = State.RUN
    key: str | None = None
    """Digest of what it is made of, once all of that is stored (see `pipeline/address.py`)."""
    behind: bool = False
    """Something above is to run first; if that gives what is known, this need not run."""
    accepted: tuple[str, ...] = ()
    """Older versions that were taken for today's, by somebody's word, for this node or above it: `<stage> of version
    <n>` (see `pipeline/planning/acceptance.py`)."""
    forced: bool = False
    """It is stored, and is to be made again."""
    reason: str = ""
    """Why it is blocked."""

    def upstream(self) -> Iterator[Node | LeafNode]:
        yield from self.after
        for value in self.inputs.values():
            if isinstance(value, list):
                yield from value
            elif value is not None:
                yield value
