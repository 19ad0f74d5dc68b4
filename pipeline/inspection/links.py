"""Links: where a node of a plan is served by an artifact that another recipe made, and what upstream made that so."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from b23d.pipeline.errors import B23dError
from b23d.pipeline.planning.nodes import LeafNode, Node, State
from b23d.pipeline.run import Run


def cuts(run: Run, node: Node) -> Iterator[str]:
    """What was made anew and gave what was known, so that `node` is served by an artifact of another recipe: a line
    each; none where it is served by its own."""
    if node.address == node.recipe:
        return
    try:
        told = run.store.head(node.stage, node.address).provenance
        yield from _above(run, node, told["inputs"], told.get("inline", {}))
    except (B23dError, KeyError, TypeError):
        return


def _above(run: Run, node: Node, before: Mapping[str, Any], inline: Mapping[str, Any]) -> Iterator[str]:
    for name, value in node.inputs.items():
        now = value if isinstance(value, list) else [value]
        then = before.get(name)
        for item, other in zip(now, then if isinstance(then, list) else [then], strict=False):
            if item is None or isinstance(item, LeafNode) or item.recipe == other or not isinstance(other, str):
                continue
            if item.state is State.TRANSIENT and other in inline:
                yield from _above(run, item, inline[other]["inputs"], inline)
            elif item.address != item.recipe:
                yield from cuts(run, item)
            else:
                content = run.store.head(item.stage, item.address).content
                yield (
                    f"{item.stage} of {item.shape} ({item.address[:12]}) was made anew and holds what "
                    f"{other[:12]} held (content {content[:12]})"
                )
