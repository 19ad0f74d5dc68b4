"""Bad files: each is a clear ValueError that names the shape, or is read; nothing else, whatever the bytes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.stages.geometry.loading import load
from b23d.stages.geometry.surface import Surface
from tests.test_loading import COLORS, POINTS, SQUARE, npz, obj, pcd, ply

TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"


@pytest.mark.parametrize(
    ("data", "name", "words"),
    [
        (b"", "m.obj", "empty file"),
        (b" \n", "m.ply", "empty file"),
        (b"# nothing\n", "m.obj", "neither"),
        (
            TRIANGLE + b"f 1 2 4\n",
            "m.obj",
            r"face 0: expected an index from 1 to 3, .* 3 vertices, got 4 \(1 such face\)",
        ),
        (
            TRIANGLE + b"f 1 2 3\nf 1 2 -4\n",
            "m.obj",
            r"face 1: expected an index from 1 to 3, .* 3 vertices, got -4 \(",
        ),
        (TRIANGLE + b"f 0 1 2\n", "m.obj", r"got 0 \(1 such face\)"),
        (b"f 1 2 3\n", "m.obj", r"face 0: expected no face, as the file has 0 vertices, got 1 \("),
        (TRIANGLE + b"f -1 -2 -3\nf -1 -9 -3\n", "m.obj", r"line 5: face 1: .* got -9 \("),
        (TRIANGLE + b"f 1 2 x\n", "m.obj", r"expected numbers, got 'x'"),
        (TRIANGLE + b"v 1 2\nf 1 2 3\n", "m.obj", "line 4: vertex 3: expected 3 numbers, got 2"),
        (b"not a mesh", "m.ply", "header"),
        (ply(np.array(SQUARE), [[0, 1, 2], [2, 3, 9]], "ascii"), "m.ply", r"face 1: .* got 9"),
        (ply(np.array(SQUARE), [[0, 1, 2, 3], [2, 3, -1]], "binary_little_endian"), "m.ply", r"face 1: .* got -1"),
        (ply(np.array(SQUARE), [[0, 1, 2]], "binary_little_endian")[:-9], "m.ply", "ends before"),
        (ply(np.array(SQUARE), [[0, 1, 2]], "ascii")[:-12], "m.ply", "ends before"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 3\n", "m.off", r"face 0: .* got 3"),
        (b"OFF\n3 1 0\n0 0 0\n1 0 0\n", "m.off", "expected 3 vertices and 1 face, got 2 lines"),
        (b"OFF\n0 0 0\n", "m.off", "neither"),
        (b"garbage that is no stl", "m.stl", "m.stl"),
        (b"garbage that is no glb", "m.glb", "JSON"),
        (pcd("ascii", "U")[:-20], "c.pcd", "expected 4 rows of 6 numbers"),
        (pcd("binary", "U")[:-1], "c.pcd", "expected 72 bytes, got 71"),
        (pcd("ascii", "U").replace(b"DATA ascii", b"DATA brotli"), "c.pcd", "line 11: .* got brotli; convert it"),
        (b"PK nonsense", "c.npz", "npz archive"),
        (npz(points=np.zeros((4, 2))), "c.npz", r"got points \(4, 2\)"),
        (b"1 2\n3 4\n", "c.xyz", "lines of x y z"),
        (b"hello", "m.doc", "expected one of .ply"),
    ],
)
def test_bad_files_are_clear_errors(data: bytes, name: str, words: str) -> None:
    with pytest.raises(ValueError, match=words) as error:
        load("chair/one", {name: data}, name)
    assert str(error.value).startswith("chair/one: ")
    assert "; " in str(error.value), "says what to do"


def test_pickled_arrays_are_never_loaded() -> None:
    with pytest.raises(ValueError, match="plain arrays"):
        load("s", {"c.npz": npz(points=np.array([{}], object))}, "c.npz")


FORMATS: dict[str, Callable[[], bytes]] = {
    "m.obj": lambda: obj(np.array(SQUARE), [[0, 1, 2, 3], [2, 3, 4]], "mixed", False, "\n"),
    "a.ply": lambda: ply(np.array(SQUARE), [[0, 1, 2, 3], [2, 3, 4]], "ascii"),
    "b.ply": lambda: ply(np.array(SQUARE), [[0, 1, 2, 3], [2, 3, 4]], "binary_little_endian"),
    "m.off": lambda: b"OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 1 2\n3 1 2 3\n",
    "m.stl": lambda: trimesh.creation.box().export(file_type="stl"),
    "m.glb": lambda: trimesh.creation.box().export(file_type="glb"),
    "a.pcd": lambda: pcd("ascii", "U"),
    "b.pcd": lambda: pcd("binary", "U"),
    "c.npz": lambda: npz(points=POINTS, colors=COLORS),
    "c.xyz": lambda: b"0 0 0\n1 0 0\n0 1 0\n",
}


@settings(max_examples=150, deadline=None)
@given(st.sampled_from(sorted(FORMATS)), st.data())
def test_any_damage_is_read_or_a_value_error(name: str, data: st.DataObject) -> None:
    """Cut, flipped, inserted bytes: a result with faces in range, or a ValueError that names the shape; nothing
    else."""
    whole = bytearray(FORMATS[name]())
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, max(len(whole) - 1, 0)))
        kind = data.draw(st.sampled_from(["cut", "set", "insert", "digit"]))
        if kind == "cut":
            del whole[at:]
        elif kind == "insert":
            whole[at:at] = data.draw(st.binary(max_size=5))
        elif len(whole) > at:
            whole[at] = data.draw(st.integers(0, 255) if kind == "set" else st.sampled_from(b"0123456789- \n.e"))
    try:
        read = load("chair/one", {name: bytes(whole)}, name)
    except ValueError as error:
        assert str(error).startswith("chair/one: ")
    else:
        if isinstance(read, Surface):
            assert len(read.faces) == 0 or (read.faces.min() >= 0 and read.faces.max() < len(read.vertices))
