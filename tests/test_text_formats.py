"""Formats of text: decimal commas, byte order marks, dialects; read right, or refused with the file and the line."""

from __future__ import annotations

import unicodedata

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.stages.geometry.loading import load
from b23d.stages.geometry.surface import Cloud, Surface
from tests.reading import box, cloud, surface

POINTS = [(0.5, -1.25, 2), (3, 4.75, 5.5), (-0.125, 0, 0.001), (7, 8.5, 9)]
SIDES = [7.125, 9.75, 8.999]


def rows(separator: str = " ", decimal: str = ".") -> list[str]:
    return [separator.join(str(x).replace(".", decimal) for x in point) for point in POINTS]


def texts(separator: str = " ", decimal: str = ".") -> dict[str, str]:
    """Two triangles over the points, or the points alone, in every format of text."""
    lines = rows(separator, decimal)
    head = "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\n"
    head += "property list uchar int vertex_indices\nend_header\n"
    pcd = "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 4\nHEIGHT 1\nPOINTS 4\nDATA ascii\n"
    stl = "solid é\n" + "".join(
        "facet normal 0 0 1\nouter loop\n" + "".join(f"vertex {lines[i]}\n" for i in face) + "endloop\nendfacet\n"
        for face in ((0, 1, 2), (0, 2, 3))
    )
    return {
        "m.obj": "".join(f"v {line}\n" for line in lines) + "f 1 2 3\nf 1 3 4\n",
        "m.off": "OFF\n4 2 0\n" + "\n".join(lines) + "\n3 0 1 2\n3 0 2 3\n",
        "m.ply": f"ply\nformat ascii 1.0\n{head}" + "\n".join(lines) + "\n3 0 1 2\n3 0 2 3\n",
        "m.stl": stl + "endsolid\n",
        "c.xyz": "\n".join(lines) + "\n",
        "c.pcd": pcd + "\n".join(lines) + "\n",
    }


def read_any(data: bytes, name: str) -> Surface | Cloud:
    return load("class/shape", {name: data}, name)


NAMES = sorted(texts())


@pytest.mark.parametrize("name", NAMES)
def test_decimal_commas_read_as_points(name: str) -> None:
    assert box(read_any(texts(decimal=",")[name].encode(), name)) == SIDES


@pytest.mark.parametrize("separator", [",", ", ", ";", "; ", "\t", " ; ", "   "])
@pytest.mark.parametrize("decimal", [".", ","])
def test_separators_of_a_cloud(separator: str, decimal: str) -> None:
    """All but the two that cannot be told apart, which are refused."""
    data = "\n".join(rows(separator, decimal)).encode()
    if decimal == "," and "," in separator:
        with pytest.raises(ValueError, match=r"class/shape: c.xyz: .*line [134]"):
            cloud(data, "c.xyz")
    else:
        assert box(cloud(data, "c.xyz")) == SIDES


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("odd", ["1,5 2.5 3", "1.234,5 2 3", "1.0D+00 2 3", "1_0 2 3", "0x1 2 3"])
def test_numbers_of_two_meanings_are_refused_by_file_and_line(name: str, odd: str) -> None:
    text = texts()[name]
    line = next(i for i, given in enumerate(text.split("\n"), 1) if rows()[1] in given)
    with pytest.raises(ValueError, match=f"class/shape: {name}: line {line}: ") as error:
        read_any(text.replace(rows()[1], odd).encode(), name)
    assert "; " in str(error.value)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"])
def test_byte_order_marks(name: str, encoding: str) -> None:
    assert box(read_any(texts()[name].encode(encoding), name)) == SIDES


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("end", ["\r\n", "\r"])
def test_line_ends(name: str, end: str) -> None:
    assert box(read_any(texts()[name].replace("\n", end).encode("latin-1"), name)) == SIDES


@pytest.mark.parametrize(
    "head",
    [
        "off\n4 2",
        "OFF 4 2 0",
        "OFF4 2 0",
        "# x\n\nOFF # y\n# z\n4 2 0 # w",
        "\ufeffOFF\n4 2 9\n\n",
        "OFF\n4\n2 0",
        "Off\t4\t2\t0",
    ],
)
@pytest.mark.parametrize("tail", ["", "\n\n# end", " 255 0 0", "\nend of file", "\n0.5 1 2"])
def test_off_heads_and_tails(head: str, tail: str) -> None:
    read = surface((f"{head}\n" + "\n".join(rows()) + "\n3 0 1 2\n3 0 2 3" + tail).encode(), "m.off")
    assert box(read) == SIDES
    assert len(read.faces) == 2
    assert read.problems == ({"trailing_lines": 1} if "end of" in tail or "0.5" in tail else {})


@pytest.mark.parametrize(
    ("kind", "more"),
    [
        ("COFF", " 9 8 7 255"),
        ("NOFF", " 0 0 1"),
        ("CNOFF", " 0 0 1 9 8 7 255"),
        ("STOFF", " 0.5 0.5"),
        ("STCNOFF", " 0 0 1 9 8 7 1 0.5 0.5"),
        ("4OFF", " 1"),
    ],
)
def test_off_and_its_kin(kind: str, more: str) -> None:
    text = f"{kind}\n4 2\n" + "\n".join(line + more for line in rows()) + "\n3 0 1 2 1 0 0\n3 0 2 3 0 0 1\n"
    read = surface(text.encode(), "m.off")
    assert box(read) == SIDES
    if "C" in kind:
        assert read.vertex_colors is not None
        assert (read.vertex_colors == [9, 8, 7]).all()
    else:
        assert [material.color for material in read.materials] == [(0, 0, 255), (255, 0, 0)]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("OFF\n4 2\n" + "\n".join(rows()) + "\n3 0 1 2\n3 0 2 3\n3 1 2 3\n", "line 9: .*another face"),
        ("OFF\n4 1\n" + "\n".join(rows()) + "\n4 0 1 2\n", "line 7: face 0: .* got 4 and 3"),
        ("OFF\n4 1\n" + "\n".join([*rows()[:3], "1 2"]) + "\n3 0 1 2\n", "line 6: vertex 3: expected 3 numbers, got 2"),
        ("OFF\n4 1\n" + "\n".join([*rows()[:3], "1 2 3 4"]) + "\n3 0 1 2\n", "line 6: vertex 3: .* got 4"),
        ("OFF BINARY\n4 1\n", "line 1: "),
        ("nOFF\n3\n4 1\n", "line 1: "),
    ],
)
def test_off_that_contradicts_itself_is_refused_with_the_line(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=f"class/shape: m.off: {words}"):
        surface(text.encode(), "m.off")


FACES = b"usemtl %b\nf 1 2 3\n"
VERTICES = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def mtl(name: str, color: str) -> bytes:
    return f"newmtl {name}\nKd {color}\n".encode()


@pytest.mark.parametrize(
    ("lines", "files"),
    [
        ("mtllib red.mtl other.mtl", ["red.mtl"]),
        ("mtllib other.mtl red.mtl", ["red.mtl"]),
        ("mtllib my red paint.mtl", ["my red paint.mtl"]),
        ("mtllib a b.mtl my red.mtl", ["my red.mtl"]),
        ("mtllib lost.mtl\nmtllib red.mtl", ["red.mtl"]),
        ('mtllib "my red.mtl"', ["my red.mtl"]),
        ("mtllib rød.mtl", [unicodedata.normalize("NFD", "rød.mtl")]),
        ("mtllib " + unicodedata.normalize("NFD", "grün.mtl"), ["grün.mtl"]),
        ("mtllib RED.MTL", ["red.mtl"]),
        ("MTLLIB red.mtl", ["red.mtl"]),
        ("mtllib .\\paints\\red.mtl", ["paints/red.mtl"]),
    ],
)
def test_the_material_files_that_a_line_may_mean(lines: str, files: list[str]) -> None:
    data = lines.encode() + b"\n" + VERTICES + FACES % b"the red one"
    read = surface(data, "m.obj", {name: mtl("the red one", "1 0 0") for name in files})
    assert read.materials[0].color == (255, 0, 0)
    lost = any(name in lines for name in ("lost", " b.mtl", "other"))
    assert read.problems.get("missing_material_files", 0) == lost


def test_material_files_with_decimal_commas_and_marks() -> None:
    data = b"mtllib a.mtl\n" + VERTICES + FACES % b"a"
    read = surface(data, "m.obj", {"a.mtl": b"\xef\xbb\xbfnewmtl a\nKd 1,0 0,5 0,0\n"})
    assert read.materials[0].color == (255, 128, 0)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_obj_vertices_in_every_spelling(data: st.DataObject) -> None:
    """Blanks, tabs, weights, colours, continued lines, comments, groups."""
    gap = st.sampled_from([" ", "  ", "\t", " \\\n "])
    extra = data.draw(st.sampled_from(["", " 1", " 0.5 0.5 1", " 1.0 0.5 0.5 1"]))
    lines = []
    for x, y, z in POINTS:
        lines.append(data.draw(st.sampled_from(["", "# v 9 9 9\n", "g a b\n", "\n", "s off\n", "o v\n"])))
        lines.append(f"v{data.draw(gap)}{x}{data.draw(gap)}{y}{data.draw(gap)}{z}{extra}\n")
    corner = data.draw(st.sampled_from(["{0}", "{0}/{0}", "{0}//{0}", "{0}/{0}/{0}", "{0}/"]))
    for face in ((1, 2, 3), (-4, -2, -1)):
        lines.append("f " + data.draw(gap).join(corner.format(i) for i in face) + "\n")
    read = surface("".join(lines).encode(), "m.obj")
    np.testing.assert_array_equal(read.vertices, POINTS)
    np.testing.assert_array_equal(read.faces, [[0, 1, 2], [0, 2, 3]])
    assert (read.vertex_colors is not None) == ("0.5" in extra)


def test_lines_are_counted_behind_continued_ones() -> None:
    with pytest.raises(ValueError, match=r"class/shape: m.obj: line 5: face: expected numbers, got 'x'"):
        surface(b"v 0 0 \\\n0\nv 1 0 0\nv 0 1 0\nf 1 2 x\n", "m.obj")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("3\n0 0 0\n1 0 0\n", "expected 3, as the first line says, got 2"),
        ("0 0 0\n1 0 0 5\n", "line 2 of 4"),
        ("0 0 0\n1 0 0\nend of scan\n2 0 0\n", "line 3: points: expected numbers, got 'end'"),
        ("0 0 0\n\n1 x 0\n", "line 3: points: expected numbers, got 'x'"),
    ],
)
def test_xyz_that_contradicts_itself_is_refused_with_the_line(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=f"class/shape: c.xyz: .*{words}"):
        cloud(text.encode(), "c.xyz")


def test_an_obj_in_capitals_is_a_mesh_and_no_cloud() -> None:
    data = b"MTLLIB a.mtl\n" + VERTICES.upper() + (FACES % b"A").upper()
    read = surface(data, "m.obj", {"a.mtl": b"NEWMTL A\nKD 1 0 0\n"})
    assert len(read.faces) == len(surface(VERTICES + FACES % b"A", "m.obj").faces)
    assert read.materials[0].color == (255, 0, 0)
    assert not read.problems


@pytest.mark.parametrize("lines", ["mtllib C:\\paints\\red.mtl", "mtllib /paints/red.mtl", "mtllib red.mtl", ""])
def test_a_material_that_no_file_has_is_counted(lines: str) -> None:
    data = lines.encode() + b"\n" + VERTICES + FACES % b"the red one"
    assert surface(data, "m.obj", {"red.mtl": mtl("another", "1 0 0")}).problems == {"missing_materials": 1}


def test_six_columns_of_commas_that_may_be_three_decimals_are_refused() -> None:
    with pytest.raises(ValueError, match=r"c\.xyz: line 2: points: expected numbers with decimal points"):
        cloud(b"1,3,0,8,1,0\n1,30,0,80,1,00\n", "c.xyz")
    assert len(cloud(b"1,3,0,8,1,0\n1,30,0,80,1,10\n", "c.xyz").points) == 2
