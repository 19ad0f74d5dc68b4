"""An artifact as files: one chunk and one `zarr.json` an array, and the head."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import numpy as np

from b23d.pipeline.storage.head import head_bytes
from b23d.pipeline.storage.zarr_format import array_metadata, chunk_key, encode
from b23d.schemas.artifact import Artifact


def encode_artifact(
    stage: str, address: str, key: str | None, artifact: Artifact, provenance: dict[str, Any], metadata_name: str
) -> tuple[dict[str, bytes], bytes, str]:
    """Files by their names below the artifact, the head's bytes, and the content's digest."""
    files: dict[str, bytes] = {}
    arrays: dict[str, dict[str, Any]] = {}
    metadata: dict[str, dict[str, Any]] = {}
    specs = artifact.array_specs()
    for name, value in artifact.present_arrays().items():
        value = np.ascontiguousarray(value)
        sharded = specs[name].sharded and value.size > 0
        data = encode(value, sharded)
        metadata[name] = array_metadata(value.shape, value.dtype, sharded)
        files[f"{name}/{chunk_key(value.shape)}"] = data
        files[f"{name}/{metadata_name}"] = json.dumps(metadata[name]).encode()
        arrays[name] = {
            "shape": value.shape,
            "dtype": value.dtype.name,
            "sharded": sharded,
            "sha256": array_digest(value),
            "stored_bytes": len(data),
        }
    schema = type(artifact).__name__
    head, content = head_bytes(stage, address, key, schema, artifact.plain_fields(), arrays, metadata, provenance)
    return files, head, content


def array_digest(array: np.ndarray) -> str:
    """sha256 of an array's elements in C order."""
    return hashlib.sha256(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data).hexdigest()
