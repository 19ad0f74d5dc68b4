"""What stored artifacts gave, and of what: where reuse that recipes cannot see is found (see `pipeline/address.py`).

Told by the index, and by the heads of what the index does not know: of another machine's artifacts, or where the index
was lost. Heads of older stores name no key; theirs is worked out from their provenance, where that still adds up to
their own address, and the artifact is otherwise found by its recipe alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from b23d.pipeline.address import Inputs, StageAddress
from b23d.pipeline.errors import B23dError
from b23d.pipeline.planning.nodes import LeafNode, Node, State
from b23d.pipeline.storage.index import Given, Index
from b23d.pipeline.store import Store

Told = Mapping[str, Any]
"""How an artifact was made: stage, version, params, inputs, as its provenance has it."""


class Contents:
    """Contents and keys of the artifacts of a run's stages. `makers` and `fingerprints`: of each stage, as the run has
    it; `present`: its stored addresses."""

    def __init__(
        self,
        store: Store,
        index: Index,
        present: dict[str, set[str]],
        makers: dict[str, StageAddress],
        fingerprints: dict[str, dict[str, str]],
        transient: frozenset[str],
        accepted: Mapping[str, Mapping[int, StageAddress]] | None = None,
    ) -> None:
        """`accepted`: stage → older version that is taken for today's → its maker."""
        self.store, self.index, self.present = store, index, present
        self.makers, self.fingerprints, self.transient = makers, fingerprints, transient
        self.accepted = accepted or {}
        self._given: dict[str, dict[str, Given]] = {}
        self._at: dict[str, dict[str, str]] = {}
        self._old: dict[str, dict[str, Told]] = {}
        """Stage → address → provenance, of heads that name no key."""

    def key(self, node: Node) -> str | None:
        """Digest of what a node is made of; None as long as something above it is still to be made."""
        if node.key is None and (digests := self._digests(node)) is not None:
            node.key = self._make(node.stage, digests)
        return node.key

    def found(self, node: Node) -> str | None:
        """Address of a stored artifact that serves a node: made of the same by the same, or by a version that was
        accepted for it (then the node says so)."""
        key = self.key(node)
        if key is None:
            return None
        if (at := self.at(node.stage, key)) is not None:
            return at
        for version, maker in self.accepted.get(node.stage, {}).items():
            older = maker({**(self._digests(node) or {}), **self.fingerprints[node.stage]})
            if (at := self.at(node.stage, older)) is not None:
                node.accepted = (f"{node.stage} of version {version}", *node.accepted)
                return at
        return None

    def _digests(self, node: Node) -> dict[str, str | list[str]] | None:
        """Argument → what stands for it in a key; None as long as something above is still to be made."""
        digests: dict[str, str | list[str]] = {}
        for argument, value in node.inputs.items():
            if isinstance(value, list):
                several = [self._digest(item) for item in value]
                if None in several:
                    return None
                digests[argument] = [digest for digest in several if digest is not None]
            elif value is not None:
                one = self._digest(value)
                if one is None:
                    return None
                digests[argument] = one
        return digests

    def at(self, stage: str, key: str) -> str | None:
        """Address of a stored artifact that was made of the same by the same; the least of several."""
        if stage not in self._at:
            self._at[stage] = self._by_key(stage)
        return self._at[stage].get(key)

    def note(self, stage: str, address: str, given: Given) -> None:
        """An artifact has been made."""
        self.present[stage].add(address)
        self._of(stage)[address] = given
        if given.key is not None and stage in self._at:
            self._at[stage][given.key] = min(address, self._at[stage].get(given.key, address))

    def _make(self, stage: str, digests: dict[str, str | list[str]]) -> str:
        inputs: Inputs = {**digests, **self.fingerprints[stage]}
        return self.makers[stage](inputs)

    def _digest(self, item: Node | LeafNode) -> str | None:
        """What stands for an input in a key: a leaf's bytes, an artifact's content, the key of what is never stored."""
        if isinstance(item, LeafNode):
            return item.address
        if item.stage in self.transient:
            return self.key(item)
        return self._content(item.stage, item.address) if item.state is State.CACHED else None

    def _content(self, stage: str, address: str) -> str | None:
        given = self._of(stage).get(address)
        return given.content if given else None

    def _of(self, stage: str) -> dict[str, Given]:
        """What is known of a stage's artifacts; heads are read of those that the index does not know."""
        if stage not in self._given:
            known = self.index.given(stage)
            present = self.present.get(stage, set())
            found: dict[str, Given] = {}
            for address in present - known.keys():
                try:
                    head = self.store.head(stage, address)
                except B23dError:
                    continue  # damaged: who reads it will see to it
                found[address] = Given(head.content, head.key)
            if found:
                self.index.note_given(stage, found)
            self._given[stage] = {**{a: known[a] for a in known.keys() & present}, **found}
        return self._given[stage]

    def _by_key(self, stage: str) -> dict[str, str]:
        at: dict[str, str] = {}
        for address in sorted(self._of(stage), reverse=True):
            given = self._given[stage][address]
            key = given.key or self._old_key(stage, address)
            if key:
                at[key] = address
        return at

    def _old_key(self, stage: str, address: str) -> str | None:
        """The key of an artifact whose head names none."""
        try:
            made = self.store.head(stage, address).provenance
            told = {"stage": stage, "version": made["version"], "params": made["params"], "inputs": made["inputs"]}
            return self._key_of(address, told, made.get("inline", {}))
        except (B23dError, KeyError, TypeError, AttributeError):
            return None

    def _key_of(self, address: str, told: Told, inline: Mapping[str, Told]) -> str | None:
        maker = StageAddress(told["stage"], told["version"], told["params"])
        fingerprints = self.fingerprints.get(told["stage"], {})
        if maker({**told["inputs"], **fingerprints}) != address:
            return None  # other weights, say: it is found by its recipe
        digests: dict[str, str | list[str]] = {}
        for argument, value in told["inputs"].items():
            several = [self._old_digest(item, inline) for item in (value if isinstance(value, list) else [value])]
            found = [digest for digest in several if digest is not None]
            if len(found) < len(several):
                return None
            digests[argument] = found if isinstance(value, list) else found[0]
        return maker({**digests, **fingerprints})

    def _old_digest(self, address: str, inline: Mapping[str, Told]) -> str | None:
        if address in inline:
            return self._key_of(address, inline[address], inline)
        for stage in self.makers:
            if (content := self._content(stage, address)) is not None:
                return content
        return address  # a leaf; or what is no longer stored, and then nothing has this key
