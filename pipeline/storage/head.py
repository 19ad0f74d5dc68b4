"""Heads: the `zarr.json` of an artifact. What it is, what it holds, what made it, and a digest of all of that.

Attributes: `head_sha256` (of the whole file, with zeros in the digest's own place), `stage`, `address`, `key` and
`content` (see `pipeline/address.py`), `schema`, `values`, `arrays` (shape, dtype, sha256 … of each), `provenance`.
Heads of older stores have only the last four; they are read as they are.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from b23d.pipeline.address import content_digest
from b23d.pipeline.storage.zarr_format import group_metadata

ZEROS = "0" * 64
_MARK = b'"head_sha256": "'
OLD = {"schema", "values", "arrays", "provenance"}
NEW = OLD | {"head_sha256", "stage", "address", "key", "content"}
UNREADABLE = (ValueError, KeyError, TypeError, AttributeError, RecursionError)
"""What reading a head's bytes raises where they are not a head's, or not those that were written."""


@dataclass(frozen=True)
class ArrayHead:
    """What is known of a stored array without reading it."""

    shape: tuple[int, ...]
    dtype: str
    sharded: bool
    sha256: str
    stored_bytes: int


@dataclass(frozen=True)
class Head:
    """What is known of an artifact without reading its arrays."""

    schema: str
    values: dict[str, Any]
    arrays: dict[str, ArrayHead]
    provenance: dict[str, Any]
    content: str = ""
    """Digest of what the artifact holds."""
    key: str | None = None
    """Digest of what it was made of: see `pipeline/address.py`. None: an older store's head, which does not say."""
    metadata: Mapping[str, Any] | None = None
    """Each array's own `zarr.json`."""

    @property
    def stored_bytes(self) -> int:
        return sum(array.stored_bytes for array in self.arrays.values())


def head_bytes(
    stage: str,
    address: str,
    key: str | None,
    schema: str,
    values: dict[str, Any],
    arrays: dict[str, dict[str, Any]],
    metadata: dict[str, dict[str, Any]],
    provenance: dict[str, Any],
) -> tuple[bytes, str]:
    """The head's bytes, and the content's digest."""
    values = json.loads(json.dumps(values))  # as a reader will have them
    content = content_digest(schema, values, arrays)
    attributes = {
        "head_sha256": ZEROS,  # comes first: the reader looks for its place from the start
        "stage": stage,
        "address": address,
        "key": key,
        "content": content,
        "schema": schema,
        "values": values,
        "arrays": arrays,
        "provenance": provenance,
    }
    data = json.dumps(group_metadata(attributes, metadata)).encode()
    return data.replace(ZEROS.encode(), hashlib.sha256(data).hexdigest().encode(), 1), content


def parse_head(data: bytes, stage: str, address: str) -> Head:
    """Raises ValueError or another of UNREADABLE where the bytes are not a head, not as written, or another
    artifact's."""
    group = json.loads(data)
    attributes = group["attributes"]
    if attributes.keys() == NEW:
        place = data.index(_MARK) + len(_MARK)
        written = data[place : place + 64].decode()
        if hashlib.sha256(data[:place] + ZEROS.encode() + data[place + 64 :]).hexdigest() != written:
            raise ValueError("expected its sha256, got other bytes")
        named = (attributes["stage"], attributes["address"])
    elif attributes.keys() == OLD:
        made = attributes["provenance"]
        named = (made.get("stage", stage), made.get("address", address))
    else:
        raise ValueError(f"expected the attributes of a head, got {', '.join(sorted(attributes))[:120]}")
    if named != (stage, address):
        raise ValueError(f"expected {stage} {address[:12]}, got {named[0]} {str(named[1])[:12]}")
    arrays = {name: ArrayHead(**{**a, "shape": tuple(a["shape"])}) for name, a in attributes["arrays"].items()}
    content = attributes.get("content") or content_digest(
        attributes["schema"], attributes["values"], attributes["arrays"]
    )
    metadata = group["consolidated_metadata"]["metadata"]
    return Head(
        attributes["schema"],
        attributes["values"],
        arrays,
        attributes["provenance"],
        content,
        attributes.get("key"),
        metadata,
    )
