"""Addresses: what an artifact is, derived from everything that made it.

    address = sha256(canonical_json({recipe, stage, version, params, inputs: {argument: address | [address, …]}}))

A leaf's address is the sha256 of its values and its files' bytes. Device, workers, batch sizes, paths and library
versions never enter. `tests/test_address.py` freezes the recipe with golden digests: change it only together with
`RECIPE`.
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
