"""Tasks: one artifact to make, as a small picklable value. Only addresses travel; a worker reads and writes the
store."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from b23d.pipeline.dataset import Leaf
from b23d.pipeline.planning.nodes import LeafNode, Node, State
from b23d.pipeline.storage.index import Failure
from b23d.schemas.params import Params


@dataclass(frozen=True)
class Stored:
    """An input that is in the store."""

    stage: str
    address: str
    recipe: str
    """What stands for it in addresses."""
    keep: bool = False
    """Keep it in the worker's memory: shots are read again for every target."""


@dataclass(frozen=True)
class Loaded:
    """An input that the data set gives."""

    leaf: Leaf
    address: str


@dataclass(frozen=True)
class Task:
    """Make one artifact. `inputs`: where each argument comes from; a nested Task is a transient stage, run inline."""

    stage: str
    address: str
    shape: str
    category: str
    draws: tuple[int, ...]
    shots: tuple[str, ...]
    params: Params
    inputs: dict[str, Stored | Loaded | Task | list[Stored | Loaded | Task]]
    store: str
    key: str | None = None
    """Digest of what it is made of, where that is known before."""
    accepted: tuple[str, ...] = ()
    """Older versions above it that were taken for today's."""
    after: frozenset[tuple[str, str]] = frozenset()
    """(stage, address) of checks that must have passed."""

    def input_addresses(self) -> dict[str, str | list[str]]:
        """Argument → address, as it entered this task's address."""
        return {
            name: [_recipe(i) for i in item] if isinstance(item, list) else _recipe(item)
            for name, item in self.inputs.items()
        }

    def stored_inputs(self) -> set[tuple[str, str]]:
        """(stage, address) of what must be in the store before, of transient stages' inputs and of checks too."""
        found = set(self.after)
        for task in (self, *self.nested()):
            for item in task.inputs.values():
                for each in item if isinstance(item, list) else [item]:
                    if isinstance(each, Stored):
                        found.add((each.stage, each.address))
        return found

    def nested(self) -> Iterator[Task]:
        """The transient tasks that run inside this one."""
        for item in self.inputs.values():
            for inner in item if isinstance(item, list) else [item]:
                if isinstance(inner, Task):
                    yield inner
                    yield from inner.nested()


@dataclass(frozen=True)
class Outcome:
    stage: str
    address: str
    shape: str
    seconds: float = 0.0
    """Of the stage's function and of what ran inline for it."""
    overhead: float = 0.0
    """Seconds of everything else a worker did: reading, checking, writing."""
    stored_bytes: int = 0
    peak_mb: float = 0.0
    """Most memory of the worker while it was made; of the worker so far, where the system tells no more."""
    content: str = ""
    """Digest of what was made, and of what it was made of: see `pipeline/address.py`."""
    key: str | None = None
    said: str = ""
    """What its libraries printed and warned of."""
    spared: bool = False
    """It was not run: what it would give is stored already. `seconds` are those that it would have taken."""
    failure: Failure | None = None
    warnings: tuple[str, ...] = ()
    """What the stage found odd and let pass, each naming the shape."""


def make_task(node: Node, params: dict[str, Params], store: str) -> Task:
    """The task that makes a node; its transient ancestors are nested."""

    def source(item: Node | LeafNode, keep: bool) -> Stored | Loaded | Task:
        if isinstance(item, LeafNode):
            return Loaded(item.leaf, item.address)
        if item.state is State.TRANSIENT:
            return make_task(item, params, store)
        return Stored(item.stage, item.address, item.recipe, keep)

    inputs: dict[str, Stored | Loaded | Task | list[Stored | Loaded | Task]] = {}
    for argument, value in node.inputs.items():
        if isinstance(value, list):
            inputs[argument] = [source(item, keep=True) for item in value]
        elif value is not None:
            inputs[argument] = source(value, keep=False)
    return Task(
        node.stage,
        node.recipe,
        node.shape,
        node.category,
        tuple(node.draws),
        node.shots,
        params[node.stage],
        inputs,
        store,
        node.key,
        after=frozenset((check.stage, check.address) for check in node.after),
        accepted=node.accepted,
    )


def _recipe(item: Stored | Loaded | Task) -> str:
    return item.recipe if isinstance(item, Stored) else item.address
