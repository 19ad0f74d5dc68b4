"""Why an artifact is what it is, and why it would run again: the first part of its address that differs from a stored
one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from b23d.pipeline.errors import ArtifactNotFoundError, CorruptArtifactError
from b23d.pipeline.inspection.change import Change
from b23d.pipeline.inspection.links import cuts
from b23d.pipeline.planning.nodes import LeafNode, Node
from b23d.pipeline.run import Run
from b23d.pipeline.stage import SHOT
from b23d.schemas.params import flat

BYTES = "(bytes)"


@dataclass(frozen=True)
class AddressPart:
    """One thing that enters an address."""

    name: str
    value: str


@dataclass(frozen=True)
class Explanation:
    stage: str
    shape: str
    address: str
    state: str
    parts: list[AddressPart]
    nearest: str | None
    """Address of the stored artifact compared with; None: this stage has made nothing of this shape yet."""
    differences: list[Change] = field(default_factory=list)
    """Deepest cause first: what stands at the head explains the rest."""
    cuts: list[str] = field(default_factory=list)
    """Where the chain of causes was cut: what was made anew, but gave what was known."""
    draws: list[int] = field(default_factory=list)
    """The draws that it is of; none where the stage sees no shots."""
    shots: tuple[tuple[str, ...], tuple[str, ...]] | None = None
    """The other's shots and its own, where like could not be compared with like: nothing of these shots is stored."""


def explain(run: Run, shape: str, stage: str, draw: int | None = None, against: Run | None = None) -> Explanation:
    """Explain one node of a run's plan, against the same node of another run or the nearest stored artifact: of the
    same draw, where there is one.

    Raises KeyError where the run has no such shape or stage.
    """
    node = run.node(shape, stage, draw)
    if against is None:
        return explain_node(run, node)
    try:
        other = against.node(shape, stage, node.draws[0] if draw is None and node.draws else draw)
    except KeyError:  # it is a shot in that draw of the other run
        other = against.node(shape, stage, draw)
    return explain_node(run, node, _of_node(against, other))


def explain_node(run: Run, node: Node, before: _Recipe | None = None) -> Explanation:
    """Explain a node against a recipe, or the nearest stored artifact."""
    parts = [AddressPart("stage", node.stage), AddressPart("version", str(run.config.stages[node.stage].version))]
    params = flat(run.config.params[node.stage].hashed())
    parts += [AddressPart(f"params.{name}", repr(value)) for name, value in params.items()]
    for name, above in _inputs(run, node).items():
        addresses = above if isinstance(above, list) else [above]
        parts.append(AddressPart(f"inputs.{name}", ", ".join(_describe(item) for item in addresses)))
    before, own = before or _nearest(run, node), _of_node(run, node)
    found = [] if before is None else list(_differences(run, own, before))
    unlike = before is not None and before.shots != own.shots
    return Explanation(
        node.stage,
        node.shape,
        node.address,
        node.state.value,
        parts,
        before.address if before else None,
        _unique(found),
        list(dict.fromkeys(cuts(run, node))),
        list(node.draws),
        (before.shots, own.shots) if before is not None and unlike else None,
    )


@dataclass(frozen=True)
class _Recipe:
    """What an address is made of, whether it stands in a plan or in a stored artifact's provenance."""

    run: Run
    """Whose plan, or whose store."""
    stage: str
    address: str
    version: int
    params: dict[str, Any]
    inputs: dict[str, list[str]]
    above: dict[str, Any]
    """Address of an input → Node, LeafNode, an inline recipe, or nothing known."""
    shots: tuple[str, ...] = ()
    """Names, sorted, where they are known."""


def _of_node(run: Run, node: Node) -> _Recipe:
    above = {item.recipe: item for item in node.upstream()}
    stage = run.config.stages[node.stage]
    params = flat(run.config.params[node.stage].hashed())
    fingerprint = dict(stage.fingerprint(run.config.params[node.stage])) if stage.fingerprint else {}
    inputs = {
        name: [i.recipe for i in v] if isinstance(v, list) else [v.recipe] for name, v in _inputs(run, node).items()
    }
    inputs |= {name: [value] for name, value in fingerprint.items()}
    return _Recipe(run, node.stage, node.recipe, stage.version, params, inputs, above, tuple(sorted(node.shots)))


def _of_provenance(run: Run, stage: str, address: str, told: dict[str, Any], inline: dict[str, Any]) -> _Recipe:
    inputs = {name: value if isinstance(value, list) else [value] for name, value in told["inputs"].items()}
    return _Recipe(
        run, stage, address, told["version"], flat(told["params"]), inputs, inline, tuple(sorted(told.get("shots", ())))
    )


def _stored(run: Run, stage: str, address: str) -> _Recipe | None:
    try:
        told = run.store.head(stage, address).provenance
    except (ArtifactNotFoundError, CorruptArtifactError):
        return None
    return _of_provenance(run, stage, address, told, told.get("inline", {}))


def _nearest(run: Run, node: Node) -> _Recipe | None:
    """The stored artifact of the same stage, shape and, if there is one, the same shots with the fewest differing
    parts; the latest of those."""
    stored = [
        recipe for a in run.index.made(node.stage, node.shape) if (recipe := _stored(run, node.stage, a)) is not None
    ]
    own = _of_node(run, node)
    return min(reversed(stored), key=lambda recipe: (recipe.shots != own.shots, _distance(own, recipe)), default=None)


def _distance(one: _Recipe, other: _Recipe) -> int:
    params = sum(one.params.get(k) != other.params.get(k) for k in one.params.keys() | other.params.keys())
    return params + sum(one.inputs.get(k) != other.inputs.get(k) for k in one.inputs.keys() | other.inputs.keys())


def _differences(run: Run, now: _Recipe, before: _Recipe) -> Iterator[Change]:
    if now.address == before.address:
        return
    shared = now.inputs.keys() & before.inputs.keys()
    for name in sorted(shared, key=lambda name: name.startswith(SHOT)):  # the shape's own inputs first
        ours, theirs = now.inputs[name], before.inputs[name]
        if len(ours) != len(theirs):
            yield Change(f"shots of {now.stage} ({name})", _named(before, theirs), _named(now, ours))
            continue
        found = [
            d
            for mine, other in zip(ours, theirs, strict=True)
            for d in _input_differences(run, now, before, name, mine, other)
        ]
        if name.startswith(SHOT) and any(difference.field.endswith(BYTES) for difference in found):
            yield Change(
                f"shots of {now.stage} ({name})", _named(before, theirs), _named(now, ours)
            )  # other shapes, not other parameters
        else:
            yield from found
    if now.version != before.version:
        yield Change(f"{now.stage}.version", str(before.version), str(now.version))
    both = now.params.keys() & before.params.keys()  # these first: another choice brings and takes fields of its own
    for key in sorted(now.params.keys() | before.params.keys(), key=lambda key: (key not in both, key)):
        if now.params.get(key) != before.params.get(key):
            yield Change(f"stages.{now.stage}.{key}", before.params.get(key), now.params.get(key))


def _input_differences(run: Run, now: _Recipe, before: _Recipe, name: str, mine: str, other: str) -> Iterator[Change]:
    if mine == other:
        return
    above, known = now.above.get(mine), before.above.get(other)
    if not isinstance(above, Node):
        yield Change(f"{name} of {now.stage} {BYTES}", other[:12], mine[:12])
        return
    if isinstance(known, Node):
        recipe: _Recipe | None = _of_node(before.run, known)
    elif isinstance(known, dict):
        recipe = _of_provenance(before.run, above.stage, other, known, before.above)
    else:
        recipe = _stored(before.run, above.stage, other)
    if recipe is None:
        yield Change(f"{above.stage} (no longer stored)", other[:12], mine[:12])
    else:
        yield from _differences(run, _of_node(run, above), recipe)


def _inputs(run: Run, node: Node) -> dict[str, Node | LeafNode | list[Node | LeafNode]]:
    return {name: value for name, value in node.inputs.items() if value is not None}


def _describe(item: Node | LeafNode) -> str:
    if isinstance(item, LeafNode):
        return f"leaf {item.address[:12]}"
    return f"{item.stage} of {item.shape} {item.address[:12]} ({item.state.value})"


def _unique(found: list[Change]) -> list[Change]:
    return list({str(change): change for change in found}.values())  # values may be lists: no hash


def _named(recipe: _Recipe, addresses: list[str]) -> str:
    """A draw's shots by name; by address where an artifact does not tell them."""
    if len(recipe.shots) == len(addresses):
        return ", ".join(recipe.shots)
    return "[" + ", ".join(address[:8] for address in addresses) + "]"
