"""PLY, ASCII and binary, with mixed polygons, vertex or corner texture coordinates. Our own reader because trimesh
renumbers the vertices of textured files and refuses binary files that mix triangles and quads (Blender's)."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from b23d.stages.geometry.companions import ply_textures
from b23d.stages.geometry.images import decode, find
from b23d.stages.geometry.surface import (
    Cloud,
    MalformedError,
    Material,
    Surface,
    check_faces,
    fans,
    to_uint8,
    unique_colors,
)
from b23d.stages.geometry.text import integers, numbers, plain, uncommented

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8", "int64": "i8", "uint64": "u8",
}  # fmt: skip
Lists = tuple[np.ndarray, np.ndarray]
"""A list property: how many values each row has, and all values one after another."""


@dataclass
class Property:
    name: str
    type: np.dtype
    count: np.dtype | None = None
    """Type of the length of a list; None for a single value."""


@dataclass
class Element:
    name: str
    rows: int
    properties: list[Property] = field(default_factory=list)


@dataclass
class Body:
    """What follows the header: bytes (uint8) of a binary file; numbers (float64) of an ASCII one, where every value
    takes one place whatever its type."""

    data: np.ndarray
    ascii: bool

    def size(self, kind: np.dtype) -> int:
        """Places that a value of this type takes."""
        return 1 if self.ascii else kind.itemsize

    def read(self, at: np.ndarray, kind: np.dtype, element: Element) -> np.ndarray:
        """The values that begin at these places. Raises MalformedError where the file ends before."""
        if len(at) and at.max() + self.size(kind) > len(self.data):
            raise MalformedError(
                f"{element.name}: expected {element.rows} rows, got a file that ends before; copy or export it again"
            )
        if self.ascii:
            return self.data[at]
        return np.ascontiguousarray(self.data[at[:, None] + np.arange(kind.itemsize)]).view(kind)[:, 0]


def read_ply(data: bytes, files: dict[str, bytes], colors: bool) -> Surface | Cloud:
    """The mesh of a PLY, vertices in the file's order; a Cloud where it has no faces. Raises MalformedError."""
    elements, body = _header(data)
    tables: dict[str, dict[str, np.ndarray | Lists]] = {}
    for element in elements:
        tables[element.name], body = _rows(element, body)
    vertex, face = tables.get("vertex", {}), tables.get("face", {})
    if not all(isinstance(vertex.get(axis), np.ndarray) for axis in "xyz"):
        raise MalformedError("vertices: expected properties x, y and z, got none; export the mesh again")
    vertices = np.stack([_column(vertex, axis) for axis in "xyz"], axis=1).astype(np.float64)
    vertex_colors = _colors(vertex) if colors else None
    polygons = face.get("vertex_indices", face.get("vertex_index"))
    if not isinstance(polygons, tuple) or not len(polygons[0]):
        return Cloud(vertices, vertex_colors)

    counts, index = polygons
    triangles, polygon = fans(counts)
    surface = Surface(vertices, integers(index.astype(np.float64), "faces")[triangles], vertex_colors)
    check_faces(surface.faces, len(vertices))
    if colors:
        _texture(
            surface, vertex, face, triangles, polygon, len(index), [find(files, name) for name in ply_textures(data)]
        )
    return surface


def _header(data: bytes) -> tuple[list[Element], Body]:
    end = re.search(rb"(?m)^end_header[ \t]*(\r\n|\n|\r)", data)
    head = data[: end.start()].decode("latin-1").splitlines() if end else []
    if end is None or not head or head[0].strip() != "ply":
        raise MalformedError(
            "header: expected `ply` … `end_header`, got something else; is it a PLY file, and complete?"
        )
    order, ascii_body = "<", False
    elements: list[Element] = []
    for line in head[1:]:
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order, ascii_body = (">" if "big" in words[1] else "<"), words[1] == "ascii"
            elif words[:1] == ["element"]:
                elements.append(Element(words[1], int(words[2])))
            elif words[:2] == ["property", "list"]:
                count, kind = (np.dtype(order + TYPES[word]) for word in words[2:4])
                elements[-1].properties.append(Property(words[4], kind, count))
            elif words[:1] == ["property"]:
                elements[-1].properties.append(Property(words[2], np.dtype(order + TYPES[words[1]])))
        except (IndexError, KeyError, ValueError) as error:
            raise MalformedError(
                f"header: expected a PLY header line, got {line[:60]!r}; export the file again"
            ) from error
    if ascii_body:
        return elements, Body(numbers(uncommented(plain(data[end.end() :])), "data"), True)
    return elements, Body(np.frombuffer(data, np.uint8)[end.end() :], False)


def _rows(element: Element, body: Body) -> tuple[dict[str, np.ndarray | Lists], Body]:
    """The properties of one element, and the rest of the body. Raises MalformedError."""
    smallest = sum(body.size(p.count or p.type) for p in element.properties)
    if element.rows < 0 or element.rows * smallest > len(body.data):
        raise MalformedError(
            f"{element.name}: expected {element.rows} rows, got a file that ends before; copy or export it again"
        )
    if not element.rows or not smallest:
        return {}, body
    starts = _starts(element, body)
    table: dict[str, np.ndarray | Lists] = {}
    at = starts
    for prop in element.properties:
        if prop.count is None:
            table[prop.name] = body.read(at, prop.type, element)
            at = at + body.size(prop.type)
        else:
            counts = integers(body.read(at, prop.count, element).astype(np.float64), element.name)
            if (counts < 0).any() or counts.sum() > len(body.data):
                raise MalformedError(
                    f"{element.name}: expected short lists, got one of {counts.max()}; copy or export the file again"
                )
            at = at + body.size(prop.count)
            within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
            table[prop.name] = (
                counts,
                body.read(np.repeat(at, counts) + within * body.size(prop.type), prop.type, element),
            )
            at = at + counts * body.size(prop.type)
    return table, Body(body.data[at[-1] :], body.ascii)


def _starts(element: Element, body: Body) -> np.ndarray:
    """Where each row begins: (rows,) int64.

    Rows with lists have no fixed length. If all are as long as the first, that is quickly seen. If not, `after` says
    for every place where a row that began there would end; squaring it finds all rows in log2(rows) steps, not one by
    one.
    """
    starts = np.arange(element.rows) * int(_ends(element, body, np.zeros(1, np.int64))[0])
    if starts[-1] < len(body.data) and (_ends(element, body, starts) == starts + starts[min(1, len(starts) - 1)]).all():
        return starts
    after = _ends(element, body, np.arange(len(body.data) + 1))
    starts = np.zeros(1, np.int64)
    while len(starts) < element.rows:
        starts = np.concatenate([starts, after[starts]])
        after = after[after]
    return starts[: element.rows]


def _ends(element: Element, body: Body, starts: np.ndarray) -> np.ndarray:
    """Where rows that begin at `starts` would end, at most the body's end; lengths of lists that make no sense count as
    0."""
    last = len(body.data)
    at = starts
    for prop in element.properties:
        counts: np.ndarray | int = 1
        if prop.count is not None:
            lengths = body.read(np.minimum(at, last - body.size(prop.count)), prop.count, element).astype(np.float64)
            counts = np.clip(np.nan_to_num(lengths, posinf=0.0), 0, last).astype(np.int64)
            at = at + body.size(prop.count)
        at = np.minimum(at + counts * body.size(prop.type), last)
    return at


def _column(table: dict[str, np.ndarray | Lists], name: str) -> np.ndarray:
    column = table[name]
    assert isinstance(column, np.ndarray)
    return column


def _colors(table: dict[str, np.ndarray | Lists]) -> np.ndarray | None:
    for names in (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue")):
        if all(isinstance(table.get(name), np.ndarray) for name in names):
            return to_uint8(np.stack([_column(table, name) for name in names], axis=1))
    return None


def _texture(
    surface: Surface,
    vertex: dict[str, np.ndarray | Lists],
    face: dict[str, np.ndarray | Lists],
    triangles: np.ndarray,
    polygon: np.ndarray,
    corners: int,
    images: list[bytes | None],
) -> None:
    """Corner or vertex texture coordinates with their images; else face colours as one material each."""
    decoded = [decode(image) if image else None for image in images]
    surface.materials = [Material(image=image) for image in decoded]
    if missing := sum(image is None for image in decoded):
        surface.problems["missing_textures"] = missing
    texcoord = face.get("texcoord")
    if isinstance(texcoord, tuple) and len(texcoord[1]) == 2 * corners and images:
        surface.face_uvs = texcoord[1].astype(np.float64).reshape(-1, 2)[triangles]
    elif images:
        for names in (("texture_u", "texture_v"), ("u", "v"), ("s", "t")):
            if all(isinstance(vertex.get(name), np.ndarray) for name in names):
                surface.face_uvs = np.stack([_column(vertex, name) for name in names], axis=1).astype(np.float64)[
                    surface.faces
                ]
                break
    if surface.face_uvs is not None:
        number = face.get("texnumber")
        of_polygon = (
            integers(number.astype(np.float64), "texnumber")
            if isinstance(number, np.ndarray)
            else np.zeros(len(polygon), int)
        )
        of_face = of_polygon[polygon]
        surface.face_materials = np.where(of_face < len(images), of_face, -1)
    elif surface.vertex_colors is None and (face_colors := _colors(face)) is not None:
        palette, which = unique_colors(face_colors)
        surface.materials = [Material(color=(int(r), int(g), int(b))) for r, g, b in palette]
        surface.face_materials = which[polygon]
