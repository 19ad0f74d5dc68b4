"""Addresses: what an artifact is, derived from everything that made it.

    address = sha256(canonical_json({recipe, stage, version, params, inputs: {argument: address | [address, …]}}))

A leaf's address is the sha256 of its values and its files' bytes. Device, workers, batch sizes, paths and library
versions never enter. `tests/test_address.py` freezes the recipe with golden digests: change it only together with
`RECIPE`.

What an input *gave* decides, not how it was made. An address names a recipe, and is known before anything has run; but
two recipes may give the same. So an artifact's head also holds two digests:

    content = sha256 of what it holds: schema, values, arrays; provenance and encoding are left out
    key     = the address's own formula, with each input's content in place of its address

Equal keys: the same stage, version and parameters have seen the very same inputs, so they give the same, and one
artifact does for both (early cut-off). Where nothing is stored at a node's address, an artifact with its key is looked
for, and taken as the node's own. So after a new version of a stage that gives what the old one gave, or a mesh saved
again with other comments, that stage runs and nothing below it. A node's key is known once all that it needs is stored;
until then the node stands behind what is to run.

Keys are only ever looked up. Addresses below a reused artifact are made of its node's own address, not of where it was
found, so they are the same on every machine and in every order of making; and a store whose keys are lost is still a
store. Contents never pass for addresses or the other way round: each digest's preimage says what it is. A stage that is
never stored (`transient`) has no content that could be known before it is run: in keys its own key stands for it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

RECIPE = 1

_ENCODER = json.JSONEncoder(sort_keys=True, separators=(",", ":"), allow_nan=False, ensure_ascii=False)

Inputs = Mapping[str, str | list[str]]


def canonical_json(value: Any) -> str:
    """JSON with sorted keys, no spaces, no NaN: the same text for equal values in any process.

    Raises ValueError for NaN and infinities, TypeError for what JSON cannot say.
    """
    return _ENCODER.encode(value)


def sha256(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def leaf_address(values: Mapping[str, Any], files: Mapping[str, str]) -> str:
    """Address of a leaf: its JSON `values` and the sha256 of each file, by the file's logical name."""
    return sha256(canonical_json({"recipe": RECIPE, "leaf": {"values": values, "files": files}}))


class StageAddress:
    """Addresses of one stage at fixed version and params; all but the inputs is serialised once (a plan makes
    100,000s)."""

    def __init__(self, stage: str, version: int, params: Mapping[str, Any]) -> None:
        head = f',"params":{canonical_json(params)},"recipe":{RECIPE}'
        self._tail = f'{head},"stage":{canonical_json(stage)},"version":{version}}}'

    def __call__(self, inputs: Inputs) -> str:
        """Address of what the stage makes of `inputs` (argument → address, or addresses of shots in order).

        Arguments are identifiers and addresses hexadecimal, so their JSON is written here directly: three times as
        fast.
        """
        texts = (
            f'"{name}":["' + '","'.join(v) + '"]' if isinstance(v, list) else f'"{name}":"{v}"'
            for name, v in sorted(inputs.items())
        )
        return sha256(f'{{"inputs":{{{",".join(texts)}}}{self._tail}')


def content_digest(schema: str, values: Mapping[str, Any], arrays: Mapping[str, Mapping[str, Any]]) -> str:
    """Digest of what an artifact holds, whatever made it: its schema, its JSON values (NaN allowed), and each array's
    shape, dtype and sha256. How arrays are encoded, and the provenance, are left out."""
    told = {name: [list(array["shape"]), array["dtype"], array["sha256"]] for name, array in arrays.items()}
    content = {"recipe": RECIPE, "content": {"schema": schema, "values": values, "arrays": told}}
    return sha256(json.dumps(content, sort_keys=True, separators=(",", ":"), ensure_ascii=False))
