"""Clouds as arrays and as PCD: dialects, compression, and arrays that are something else."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.stages.geometry.lzf import decompress
from tests.reading import cloud
from tests.test_loading import COLORS, PACKED, POINTS, npz


def lzf(data: bytes) -> bytes:
    """LZF as its format has it: runs of literals, and references to what came before."""
    made, at = b"", 0
    while at < len(data):
        start = data.rfind(data[at : at + 3], max(at - 8191, 0), at + 2) if at + 3 <= len(data) else -1
        if start < 0 or start >= at:
            made, at = made + b"\0" + data[at : at + 1], at + 1
            continue
        length = 3
        while at + length < len(data) and length < 264 and data[start + length] == data[at + length]:
            length += 1
        back = at - start - 1
        short = length - 2 if length < 9 else 7
        made += bytes([short << 5 | back >> 8, *([length - 9] if short == 7 else []), back & 255])
        at += length
    return made


@given(st.binary(max_size=300) | st.lists(st.sampled_from([b"ab", b"abc", b"aaaa"]), max_size=200).map(b"".join))
def test_lzf_of_any_bytes(data: bytes) -> None:
    assert decompress(lzf(data), len(data)) == data


@settings(max_examples=80, deadline=None)
@given(st.data())
def test_pcd_in_every_spelling(data: st.DataObject) -> None:
    """Encodings, types in either case, paddings of 0 to 3 values, lines left out, BOMs, comments."""
    encoding = data.draw(st.sampled_from(["ascii", "binary", "binary_compressed"]))
    size, kind = data.draw(st.sampled_from([4, 8])), data.draw(st.sampled_from(["F", "f"]))
    padding = data.draw(st.sampled_from([0, 1, 3]))
    fields: list[tuple[str, str, int, int, np.ndarray]] = [
        (axis, kind, size, 1, POINTS[:, i : i + 1].astype(f"<f{size}")) for i, axis in enumerate("xyz")
    ]
    fields.append(("rgb", data.draw(st.sampled_from(["U", "u", "I"])), 4, 1, PACKED.reshape(4, 1).astype("<u4")))
    fields.insert(data.draw(st.integers(0, 4)), ("_", "U", 1, padding, np.zeros((4, padding), np.uint8)))
    lines = {
        "VERSION": ".7",
        "FIELDS": " ".join(field[0] for field in fields),
        "SIZE": " ".join(str(field[2]) for field in fields),
        "TYPE": " ".join(field[1] for field in fields),
        "COUNT": " ".join(str(field[3]) for field in fields),
        "WIDTH": "2",
        "HEIGHT": "2",
        "VIEWPOINT": "1 2 3 0 0 0 1",
        "POINTS": "4",
        "DATA": encoding,
    }
    for key in data.draw(st.sampled_from([(), ("POINTS",), ("VERSION", "VIEWPOINT"), ("WIDTH", "HEIGHT")])):
        del lines[key]
    if padding == 1 and data.draw(st.booleans()):
        del lines["COUNT"]
    head = "# .PCD v.7\n" + "".join(f"{key} {value}\n" for key, value in lines.items())
    if encoding == "ascii":
        rows = [
            " ".join(f"{v:.9g}" if v.dtype.kind == "f" else str(v) for f in fields for v in f[4][i]) for i in range(4)
        ]
        body = "\n".join(rows).encode()
    elif encoding == "binary":
        body = b"".join(field[4][i].tobytes() for i in range(4) for field in fields)
    else:
        whole = b"".join(field[4].tobytes() for field in fields)
        body = len(lzf(whole)).to_bytes(4, "little") + len(whole).to_bytes(4, "little") + lzf(whole)
    read = cloud(data.draw(st.sampled_from([b"", b"\xef\xbb\xbf"])) + head.encode() + body, "c.pcd")
    np.testing.assert_allclose(read.points, POINTS, rtol=1e-6)
    np.testing.assert_array_equal(read.colors, COLORS)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (b"WIDTH 4", b"WIDTH 5", "expected WIDTH × HEIGHT = POINTS, got 5 × 1 and 4"),
        (b"TYPE F F F", b"TYPE F F", "header: expected FIELDS, SIZE, TYPE"),
        (b"COUNT 1 1 1", b"COUNT 1 1", "expected as many SIZE, TYPE and COUNT as FIELDS, got 3 and 2 for 3"),
        (b"COUNT 1 1 1", b"COUNT 1 1 0", "expected FIELDS with x y z"),
        (b"FIELDS x y z", b"FIELDS a b c", "expected FIELDS with x y z"),
        (b"3 4 5", b"3 4", "line 10: expected 4 rows of 3 numbers, got a row of 2"),
        (b"3 4 5", b"3 4 five", "line 10: points: expected numbers, got 'five'"),
        (b"3 4 5\n", b"", "points: expected 4 rows of 3 numbers, got 3"),
    ],
)
def test_a_pcd_that_contradicts_itself_is_refused(old: bytes, new: bytes, words: str) -> None:
    text = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 4\nHEIGHT 1\nPOINTS 4\nDATA ascii\n"
    text += b"0 0 0\n3 4 5\n1 1 1\nnan nan nan\n"
    assert len(cloud(text, "c.pcd").points) == 4
    with pytest.raises(ValueError, match=f"class/shape: c.pcd: .*{words}"):
        cloud(text.replace(old, new), "c.pcd")


@pytest.mark.parametrize("kind", ["f2", ">f4", "f8", "i2", "u1", "i8"])
@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_of_every_type_and_order(kind: str, order: str) -> None:
    points = np.array(np.arange(24).reshape(8, 3), kind, order=order)  # type: ignore[call-overload]
    np.testing.assert_array_equal(cloud(npz(pos=points), "c.npz").points, np.arange(24).reshape(8, 3))


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"points": np.zeros((3, 600))}, r"points: expected an array \(n, 3\), got \(3, 600\), which looks transposed"),
        ({"points": np.zeros((3, 8))}, r"points: .* looks transposed; save points.T"),
        ({"xyz": np.zeros((6, 99))}, r"xyz: .* looks transposed; save xyz.T"),
        (
            {"a": np.zeros((5, 3)), "b": np.zeros((5, 3))},
            r"expected one called `points` .* a \(5, 3\) float64, b \(5, 3\)",
        ),
        ({"points": np.zeros((1, 5, 3))}, r"got points \(1, 5, 3\)"),
        ({"points": np.zeros((5, 3), complex)}, "complex"),
        ({"points": np.array([[{}, 1, 2]], object)}, "pickled objects"),
        ({}, "got none"),
    ],
)
def test_arrays_that_are_no_points_are_refused(arrays: dict[str, np.ndarray], words: str) -> None:
    with pytest.raises(ValueError, match=f"class/shape: c.npz: .*{words}"):
        cloud(npz(**arrays), "c.npz")


@pytest.mark.parametrize("kind", [b"F,04", b"C", b"S", b"M8[s]"])
def test_a_pcd_of_an_unknown_type_is_refused_by_its_name(kind: bytes) -> None:
    head = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F %s\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n" % kind
    with pytest.raises(ValueError, match=r"class/shape: c.pcd: header: expected .*TYPE.* got TYPE"):
        cloud(head + b"0 0 0\n", "c.pcd")


def test_bytes_behind_the_points_of_a_pcd_are_counted_or_refused() -> None:
    head = b"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nPOINTS 4\nDATA %b\n"
    binary = head % b"binary" + POINTS.astype("<f4").tobytes()
    packed = lzf(POINTS.T.astype("<f4").tobytes())
    compressed = head % b"binary_compressed" + len(packed).to_bytes(4, "little") + (48).to_bytes(4, "little") + packed
    for made in (binary, compressed):
        assert cloud(made, "c.pcd").problems == {}
        assert cloud(made + bytes(4096), "c.pcd").problems == {"trailing_bytes": 4096}
    with pytest.raises(ValueError, match=r"c\.pcd: header: expected 3 points, as it says, got a file that holds 4"):
        cloud(binary.replace(b"POINTS 4", b"POINTS 3"), "c.pcd")
