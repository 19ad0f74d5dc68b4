"""Damage and malice: a clear error, in bounded time and memory."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest

from tests.fuzz_readers import Outcome, fuzz, seeds, try_one
from tests.made_gltf import TABLE, Gltf

HEAD = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"


def zipped(header: bytes, body: bytes) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        text = header.ljust(118 - 10) + b"\n"
        archive.writestr("points.npy", b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + body)
    return buffer.getvalue()


def instanced() -> bytes:
    document = Gltf()
    document.mesh(np.tile(TABLE, (5000, 1)), None)
    places = document.accessor(np.zeros((60_000, 3), np.float32))
    document.add(
        "nodes", {"mesh": 0, "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": places}}}}
    )
    return document.glb()


def deep() -> bytes:
    document = Gltf()
    document.mesh()
    document.tree["nodes"] = [{"children": [i + 1]} for i in range(20_000)] + [{"mesh": 0}]
    return document.glb()


PCD = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH %d\nHEIGHT 1\nPOINTS %d\nDATA %b\n"
BOMBS = {
    "rows.ply": HEAD.replace(b"vertex 3", b"vertex 4000000000") + b"end_header\n" + bytes(36),
    "list.ply": HEAD + b"element face 1\nproperty list uint int vertex_indices\nend_header\n" + bytes(36) + b"\xff" * 8,
    "empty.ply": HEAD + b"element face 9000000000\nend_header\n" + bytes(36),
    "lists.ply": HEAD
    + b"element face 3\nproperty list double char vertex_indices\nend_header\n"
    + bytes(36)
    + b"\x7f" * 99,
    "a.off": b"OFF\n99999999999 99999999999 0\n0 0 0\n",
    "b.off": b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n9999999999 0 1 2\n",
    "a.stl": bytes(80) + b"\xfe\xff\xff\xff" + bytes(50),
    "a.pcd": PCD % (10**12, 10**12, b"binary"),
    "b.pcd": PCD % (10**9, 10**9, b"binary_compressed")
    + b"\x04\0\0\0"
    + (12 * 10**9 % 2**32).to_bytes(4, "little")
    + bytes(4),
    "c.pcd": PCD.replace(b"COUNT 1 1 1", b"COUNT 1 1 99999999999") % (1, 1, b"binary"),
    "a.npz": zipped(b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 3), }", bytes(48)),
    "b.npz": zipped(b"{'descr': '<f8', 'fortran_order': False, 'shape': (20000000, 3), }", bytes(480_000_000)),
    "a.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 99999999999999999999 1 2\n",
    "b.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1/99999999999 2/1 3/1\nf -9223372036854775808 1 2\n",
    "c.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\n" + b"f 1 2 3\\\n" * 50_000,
    "a.glb": instanced(),
    "b.glb": deep(),
    "c.gltf": b'{"asset": {"version": "2.0"}, "nodes": ' + b"[" * 100_000 + b"}",
    "d.gltf": b'{"asset": {"version": "2.0"}, "nodes": [{"mesh": 0}], '
    b'"meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], '
    b'"accessors": [{"count": 1e300, "type": "VEC3", "componentType": 5126}]}',
}


def test_a_sample_of_damaged_files() -> None:
    outcome = fuzz(300, seed=7)
    assert outcome.faults == []
    assert 0 < outcome.read < outcome.tried


@pytest.mark.parametrize("name", BOMBS)
def test_headers_that_promise_more_than_the_file_holds(name: str) -> None:
    outcome = Outcome()
    try_one(name, BOMBS[name], outcome)
    assert outcome.faults == []


def test_the_seeds_are_right() -> None:
    """Else the damage would only ever meet the first check."""
    outcome = Outcome()
    for name, data in seeds():
        try_one(name, data, outcome)
    assert outcome.read == outcome.tried, outcome.faults
