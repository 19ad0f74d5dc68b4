"""PLY: elements and properties in any order, type and length; faces never become a cloud in silence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.stages.datasets.files import has_faces
from tests.reading import cloud, surface

POINTS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64)
NAMES = {
    "i1": "char",
    "u1": "uint8",
    "i2": "short",
    "u2": "uint16",
    "i4": "int",
    "u4": "uint32",
    "f4": "float",
    "f8": "double",
}
Element = tuple[str, list[tuple[str, ...]], list[list[Any]]]
"""Name, properties (name, type) or (name, type, type of its count), rows of numbers and lists."""


def ply(elements: list[Element], encoding: str = "ascii", end: str = "\n") -> bytes:
    order = ">" if "big" in encoding else "<"
    lines = ["ply", f"format {encoding} 1.0", "comment by a test", "obj_info too"]
    body = b""
    for name, properties, rows in elements:
        lines.append(f"element {name} {len(rows)}")
        for prop, kind, *count in properties:
            lines.append(f"property {f'list {NAMES[count[0]]} ' if count else ''}{NAMES[kind]} {prop}")
        for row in rows:
            words = []
            for (_, kind, *count), value in zip(properties, row, strict=True):
                values = value if count else [value]
                words += ([str(len(values))] if count else []) + [f"{v:.9g}" for v in values]
                if encoding != "ascii":
                    body += np.array([len(values)], order + count[0]).tobytes() if count else b""
                    body += np.array(values, order + kind).tobytes()
            body += (" ".join(words) + end).encode() if encoding == "ascii" else b""
    return end.join([*lines, "end_header", ""]).encode() + body


def vertices(kind: str = "f4", more: list[tuple[str, ...]] | None = None, rest: list[Any] | None = None) -> Element:
    properties = [(axis, kind) for axis in "xyz"] + (more or [])
    return "vertex", properties, [[*point, *(rest or [])] for point in POINTS.tolist()]


ENCODINGS = ["ascii", "binary_little_endian", "binary_big_endian"]


@settings(max_examples=200, deadline=None)
@given(st.data())
def test_every_spelling(data: st.DataObject) -> None:
    """Types, orders of elements and properties, extra ones of either kind, line ends; mixed lengths or not."""
    kinds = st.sampled_from(["i1", "u1", "i2", "u2", "i4", "u4"])
    faces = data.draw(st.lists(st.sampled_from([[0, 1, 2], [0, 2, 3], [0, 1, 2, 3]]), min_size=1, max_size=5))
    name = data.draw(st.sampled_from(["vertex_indices", "vertex_index", "corners"]))
    of_faces: list[tuple[str, ...]] = [(name, data.draw(kinds), data.draw(kinds))]
    rows: list[list[Any]] = [[face] for face in faces]
    if data.draw(st.booleans()):
        of_faces, rows = [("flags", "u1"), *of_faces, ("group", "f8")], [[7, *row, 0.5] for row in rows]
    if name != "corners" and data.draw(st.booleans()):
        of_faces, rows = [*of_faces, ("normals", "f4", "u1")], [[*row, [1, 0] * i] for i, row in enumerate(rows)]
    more: list[tuple[str, ...]] = [("quality", "u1"), ("marks", "i2", "u1")] if data.draw(st.booleans()) else []
    elements: list[Element] = [
        vertices(data.draw(st.sampled_from(["f4", "f8"])), more, [3, [1, 2]] if more else None),
        ("face", of_faces, rows),
        ("edge", [("vertex1", "i4"), ("vertex2", "i4")], [[0, 1]]),
        ("material", [("shine", "f4")], []),
    ]
    made = ply(
        data.draw(st.permutations(elements)),
        data.draw(st.sampled_from(ENCODINGS)),
        data.draw(st.sampled_from(["\n", "\r\n", "\r"])),
    )
    read = surface(made, "m.ply")
    np.testing.assert_array_equal(read.vertices, POINTS)
    fan = [[face[0], face[i], face[i + 1]] for face in faces for i in range(1, len(face) - 1)]
    np.testing.assert_array_equal(read.faces, fan)
    assert read.problems == {}


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_strips_begin_anew_at_minus_one(encoding: str) -> None:
    strips: Element = (
        "tristrips",
        [("vertex_indices", "i4", "i4")],
        [[[0, 1, 2, 3, -1, 3, 2, 1, -1, 0, 1, -1]], [[1, 2, 3]]],
    )
    data = ply([vertices(), strips], encoding)
    np.testing.assert_array_equal(surface(data, "m.ply").faces, [[0, 1, 2], [1, 3, 2], [3, 2, 1], [1, 2, 3]])


def test_what_may_be_faces_is_never_a_cloud_in_silence(tmp_path: Any) -> None:
    for name, properties, row, words in (
        (
            "face",
            [("a", "i4"), ("b", "i4"), ("c", "i4")],
            [0, 1, 2],
            "face: expected a list vertex_indices, got a, b, c",
        ),
        ("quads", [("vertex_indices", "i4", "u1")], [[0, 1, 2, 3]], "quads: expected faces in an element `face`"),
        ("trifans", [("vertex_indices", "i4", "u1")], [[0, 1, 2, 3]], "trifans: expected faces"),
        (
            "face",
            [("one", "i4", "u1"), ("two", "i4", "u1")],
            [[0], [1]],
            "face: expected a list vertex_indices, got one",
        ),
    ):
        with pytest.raises(ValueError, match=f"class/shape: m.ply: {words}"):
            surface(ply([vertices(), (name, properties, [row])]), "m.ply")
    assert len(cloud(ply([vertices(), ("face", [("vertex_indices", "i4", "u1")], [])]), "m.ply").points) == 4
    grid: Element = ("range_grid", [("vertex_indices", "i4", "u1")], [[[0]], [[]]])
    assert len(cloud(ply([vertices(), grid]), "m.ply").points) == 4


@pytest.mark.parametrize(
    ("element", "expected"),
    [
        (("face", [("vertex_indices", "i4", "u1")], [[[0, 1, 2]]]), True),
        (("tristrips", [("vertex_indices", "i4", "i4")], [[[0, 1, 2]]]), True),
        (("face", [("vertex_indices", "i4", "u1")], []), False),
        (("edge", [("vertex1", "i4")], [[0]]), False),
    ],
)
def test_a_data_set_tells_meshes_from_clouds_likewise(tmp_path: Any, element: Element, expected: bool) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(ply([vertices(), element]))
    assert has_faces(str(path)) == expected


@pytest.mark.parametrize(
    ("names", "kind", "shade"),
    [
        (("red", "green", "blue"), "u1", [255, 128, 0]),
        (("diffuse_red", "diffuse_green", "diffuse_blue"), "u1", [255, 128, 0]),
        (("r", "g", "b"), "f4", [1, 0.5, 0]),
        (("red", "green", "blue"), "u2", [65535, 32768, 0]),
    ],
)
@pytest.mark.parametrize("encoding", ["ascii", "binary_big_endian"])
def test_colors_by_other_names_and_types(names: tuple[str, ...], kind: str, shade: list[Any], encoding: str) -> None:
    if kind == "u2" and encoding == "ascii":
        pytest.skip("text does not tell 16-bit colours from 8-bit ones")
    read = cloud(ply([vertices(more=[(name, kind) for name in names], rest=shade)], encoding), "m.ply")
    assert read.colors is not None
    assert read.colors[0].tolist() == [255, 128, 0]


FACE: Element = ("face", [("vertex_indices", "i4", "u1")], [[[0, 1, 2]], [[0, 2, 3]]])


def test_more_than_the_header_announces_is_counted_or_refused() -> None:
    assert surface(ply([vertices(), FACE], "binary_little_endian") + b"12", "m.ply").problems == {"trailing_bytes": 2}
    assert surface(ply([vertices(), FACE]) + b"1 2\n3\n", "m.ply").problems == {"trailing_lines": 2}
    wide = ply([vertices(), FACE]).replace(b"\n1 0 0\n", b"\n1 0 0 255\n")
    with pytest.raises(ValueError, match=r"class/shape: m.ply: line 13: vertex 1: .* got 4"):
        surface(wide, "m.ply")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            b"element vertex 4",
            b"element vertex 4000000000",
            "vertex: expected 4000000000 rows, got a file that ends before",
        ),
        (b"property float x", b"property vec3 x", "line 6: expected a PLY header line, got 'property vec3 x'"),
        (b"property float x", b"property float px", "vertex: expected properties x, y and z, got px, y, z"),
        (b"format ascii", b"format morse", "line 2: expected a PLY header line"),
        (b"3 0 1 2", b"3 0 1 9", "face 0: expected an index from 0 to 3, as the file has 4 vertices, got 9"),
        (b"3 0 1 2", b"2.5 0 1 2", "line 16: face 0: expected as many numbers"),
    ],
)
def test_headers_that_lie_are_refused(old: bytes, new: bytes, words: str) -> None:
    with pytest.raises(ValueError, match=f"class/shape: m.ply: {words}"):
        surface(ply([vertices(), FACE]).replace(old, new), "m.ply")
