"""STL: both kinds told apart by what they hold, and counts that are wrong mended or refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.reading import surface

CORNERS = np.array([[[0, 0, 0], [1, 0, 0], [0, 2, 0]], [[0, 0, 3], [1, 0, 0], [0, 2, 0]]], np.float32)


def binary(corners: np.ndarray = CORNERS, head: bytes = b"made by a test", count: int | None = None) -> bytes:
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows = np.zeros(len(corners), record)
    rows["corners"], rows["attribute"] = corners, 0x7FFF
    announced = len(corners) if count is None else count
    return head.ljust(80, b"\0") + announced.to_bytes(4, "little") + rows.tobytes()


def text(
    corners: np.ndarray = CORNERS, name: str = "a", end: str = "\n", upper: bool = False, indent: str = " "
) -> bytes:
    lines = [f"solid {name}"]
    for facet in corners.tolist():
        lines += ["facet normal 0 0 0", f"{indent}outer loop"]
        lines += [f"{indent}{indent}vertex {x:.9g}{indent}{y:.9g}  {z:.9g}" for x, y, z in facet]
        lines += [f"{indent}endloop", "endfacet"]
    made = end.join([*lines, f"endsolid {name}", ""])
    return (made.upper() if upper else made).encode("latin-1")


@settings(max_examples=80, deadline=None)
@given(st.data())
def test_every_spelling(data: st.DataObject) -> None:
    values = st.lists(st.integers(-999, 999), min_size=9, max_size=9)
    rows = data.draw(st.lists(values, min_size=1, max_size=5))
    corners = np.array(rows, np.float32).reshape(-1, 3, 3) / 8
    name = data.draw(st.sampled_from(["", "a b", "é", "facet of a vertex", "solid"]))
    if data.draw(st.booleans()):
        head = data.draw(
            st.sampled_from([b"", b"solid of a program", b"solid facet vertex", b"COLOR=\x01\x02\x03\xff"])
        )
        made = binary(corners, head, data.draw(st.sampled_from([len(corners), 0, 2**32 - 1])))
        made += data.draw(st.sampled_from([b"", b"\0", b"tail"]))
    else:
        end, indent = data.draw(st.sampled_from(["\n", "\r\n"])), data.draw(st.sampled_from([" ", "\t", "   "]))
        parts = [corners] if data.draw(st.booleans()) else [corners[:1], corners[1:]]
        made = b"".join(text(part, name, end, data.draw(st.booleans()), indent) for part in parts if len(part))
    read = surface(made, "m.stl")
    np.testing.assert_array_equal(read.vertices.reshape(-1, 3, 3), corners)
    np.testing.assert_array_equal(read.faces.ravel(), np.arange(3 * len(corners)))


@pytest.mark.parametrize(
    ("data", "problems"),
    [
        (binary(), {}),
        (binary(count=0), {"triangle_count": 1}),
        (binary(count=1), {"triangle_count": 1}),
        (binary() + b"12345", {"trailing_bytes": 5}),
        (text().replace(b"endsolid a", b""), {"no_endsolid": 1}),
        (text(CORNERS[:1]) + text(CORNERS[1:]).replace(b"endsolid a", b""), {"no_endsolid": 1}),
    ],
)
def test_what_a_header_gets_wrong_is_counted(data: bytes, problems: dict[str, int]) -> None:
    read = surface(data, "m.stl")
    assert len(read.faces) == 2
    assert read.problems == problems


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (binary(count=3), "expected 3 triangles, as it says, got a file that holds 2"),
        (binary()[:-1], "expected 2 triangles, as it says, got a file that holds 1"),
        (binary(count=1) + b"123", "expected 1 triangle, as it says, got a file that holds 2"),
        (binary(CORNERS[:0]), "expected triangles, got none"),
        (b"solid\n", "expected an ASCII STL or 84 bytes"),
        (text().replace(b"vertex 1", b"vertex x"), "line 5: vertex: expected numbers, got 'x'"),
        (text()[:-60], "line 9: facet: expected 3 vertices, got 1"),
        (text().replace(b"  vertex 1 0  0\n", b"", 1), "line 2: facet: expected 3 vertices, got 2"),
    ],
)
def test_a_file_that_contradicts_itself_is_refused(data: bytes, words: str) -> None:
    with pytest.raises(ValueError, match=f"class/shape: m.stl: .*{words}"):
        surface(data, "m.stl")
