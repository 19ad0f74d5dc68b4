"""Arrays as bytes in the zarr v3 format: one chunk an array, or one chunk per index of the first axis inside one shard.

zarr's own writer and reader take about 2 ms an array, mostly event-loop overhead, and a task handles a dozen arrays;
this is the same format in tens of microseconds. `tests/test_store.py` has zarr itself read everything written here.
Codecs: bytes (little endian) → zstd → crc32c; shards end with their index (Zarr v3 specification, sharding-indexed
v1.0).
"""

from __future__ import annotations

from typing import Any

import google_crc32c
import numpy as np
from numcodecs.zstd import Zstd

LEVEL = 1  # zstd 1 → 3 saves 2 % on features and distances, and doubles the time

_ZSTD = Zstd(LEVEL)


def encode(array: np.ndarray, sharded: bool) -> bytes:
    """The bytes of the only chunk (or shard) of `array`, which is C-contiguous and little endian."""
    if not sharded:
        return _encode_chunk(array)
    chunks = [_encode_chunk(part) for part in array]
    lengths = np.array([len(chunk) for chunk in chunks], np.uint64)
    offsets = np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.uint64)
    index = np.stack([offsets, lengths], axis=1).tobytes() if chunks else b""
    return b"".join([*chunks, index, _crc(index)])


def decode(data: bytes, shape: tuple[int, ...], dtype: str, sharded: bool) -> np.ndarray:
    """The array that `encode` was given. Raises ValueError where the bytes are damaged."""
    if not sharded:
        return _decode_chunk(data, shape, dtype)
    size = 16 * shape[0] + 4
    index, checksum = data[-size:-4], data[-4:]
    if len(data) < size or _crc(index) != checksum:
        raise ValueError("shard index: expected its crc32c, got other bytes")
    out = np.empty(shape, dtype)
    for part, (offset, length) in zip(out, np.frombuffer(index, np.uint64).reshape(-1, 2).astype(int), strict=True):
        part[...] = _decode_chunk(data[offset : offset + length], shape[1:], dtype)
    return out


def array_metadata(shape: tuple[int, ...], dtype: np.dtype, sharded: bool) -> dict[str, Any]:
    """The array's `zarr.json`."""
    codecs: list[dict[str, Any]] = [
        {"name": "bytes", "configuration": {"endian": "little"}} if dtype.itemsize > 1 else {"name": "bytes"},
        {"name": "zstd", "configuration": {"level": LEVEL, "checksum": False}},
        {"name": "crc32c"},
    ]
    if sharded:
        index_codecs = [{"name": "bytes", "configuration": {"endian": "little"}}, {"name": "crc32c"}]
        configuration = {
            "chunk_shape": [1, *shape[1:]],
            "codecs": codecs,
            "index_codecs": index_codecs,
            "index_location": "end",
        }
        codecs = [{"name": "sharding_indexed", "configuration": configuration}]
    return {
        "zarr_format": 3,
        "node_type": "array",
        "shape": list(shape),
        "data_type": dtype.name,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": [max(1, n) for n in shape]}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "fill_value": False if dtype.kind == "b" else 0,
        "codecs": codecs,
        "attributes": {},
        "storage_transformers": [],
    }


def group_metadata(attributes: dict[str, Any], arrays: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """The group's `zarr.json`, with the arrays' metadata consolidated."""
    consolidated = {"kind": "inline", "must_understand": False, "metadata": arrays}
    return {"zarr_format": 3, "node_type": "group", "attributes": attributes, "consolidated_metadata": consolidated}


def chunk_key(shape: tuple[int, ...]) -> str:
    """Key, below the array, of its only chunk."""
    return "/".join(["c", *("0" for _ in shape)])


def _encode_chunk(array: np.ndarray) -> bytes:
    data = bytes(_ZSTD.encode(np.ascontiguousarray(array).reshape(-1).view(np.uint8)))
    return data + _crc(data)


def _decode_chunk(data: bytes, shape: tuple[int, ...], dtype: str) -> np.ndarray:
    body, checksum = data[:-4], data[-4:]
    if _crc(body) != checksum:
        raise ValueError("chunk: expected its crc32c, got other bytes")
    out = np.empty(shape, dtype)
    if out.size:  # zstd decodes no empty frame into a buffer
        _ZSTD.decode(body, out=out.reshape(-1).view(np.uint8))
    return out


def _crc(data: bytes) -> bytes:
    return int(google_crc32c.value(data)).to_bytes(4, "little")
