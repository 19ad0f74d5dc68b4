"""PLY, ASCII and binary, with mixed polygons, strips, vertex or corner texture coordinates. Our own reader because
trimesh renumbers the vertices of textured files and drops strips."""

from __future__ import annotations

import numpy as np

from b23d.stages.geometry.companions import ply_textures
from b23d.stages.geometry.encoding import unmarked
from b23d.stages.geometry.images import decode, find
from b23d.stages.geometry.ply_tables import Lists, Table, read_tables
from b23d.stages.geometry.polygons import Triangles, check_corners, triangulate
from b23d.stages.geometry.strips import strip_triangles
from b23d.stages.geometry.surface import Cloud, MalformedError, Material, Surface, to_uint8
from b23d.stages.geometry.text import integers

INDICES = ("vertex_indices", "vertex_index", "vertex_ids", "indices", "vertices")
"""What programs call a face's corners; where a face has only one list of whole numbers, it may have any name."""
NO_FACES = ("vertex", "range_grid")
"""Elements whose lists are no faces: range_grid says which cells of a scanner's picture hold a point."""


def read_ply(data: bytes, files: dict[str, bytes], colors: bool) -> Surface | Cloud:
    """The mesh of a PLY, vertices in the file's order; a Cloud where it has neither faces nor strips.

    Raises MalformedError, also for an element that may be faces but cannot be read as such.
    """
    data = unmarked(data)
    tables, problems = read_tables(data)
    vertex = tables.get("vertex", {})
    if not all(isinstance(vertex.get(axis), np.ndarray) for axis in "xyz"):
        got = ", ".join(vertex) or f"elements {', '.join(tables) or 'none'}"
        raise MalformedError(f"vertex: expected properties x, y and z, got {got}; export the mesh again")
    vertices = np.stack([_column(vertex, axis) for axis in "xyz"], axis=1).astype(np.float64)
    vertex_colors = _colors(vertex) if colors else None
    name, face = next(((name, tables[name]) for name in ("face", "faces", "polygon") if name in tables), ("", {}))
    counts, index = _faces(name, face)
    strips = _strips(tables)
    _check_others(tables, {*NO_FACES, name, "tristrips"})
    problems = {what: times for what, times in problems.items() if times}
    if not len(counts) and not len(strips):
        return Cloud(vertices, vertex_colors, problems=problems)

    check_corners(index, counts, len(vertices))
    check_corners(strips.reshape(-1), np.full(len(strips), 3), len(vertices), what="triangle of a strip")
    cut = triangulate(vertices, index, counts)
    surface = Surface(vertices, np.concatenate([index[cut.corners], strips]), vertex_colors, problems=problems)
    surface.count("concave_polygons", cut.concave)
    if colors:
        images = [find(files, texture) for texture in ply_textures(data)]
        _texture(surface, vertex, face, cut, len(index), images)
    return surface


def _faces(name: str, face: Table) -> Lists:
    """Corner counts (p,) and corners (c,) int64 of the faces. Raises MalformedError where they are of no known form."""
    lists = {key: column for key, column in face.items() if isinstance(column, tuple)}
    whole = [key for key in lists if key != "texcoord"]
    chosen = next((key for key in INDICES if key in lists), whole[0] if len(whole) == 1 else None)
    if chosen is None:
        if any(len(column) for column in face.values()):
            raise MalformedError(
                f"{name}: expected a list vertex_indices, got {', '.join(face)}; export the mesh again"
            )
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    counts, index = lists[chosen]
    return counts, index.astype(np.int64) if index.dtype.kind in "iu" else integers(index, name)


def _strips(tables: dict[str, Table]) -> np.ndarray:
    """The triangles (t, 3) int64 of `tristrips`, whose strips end at -1."""
    lists = [column for column in tables.get("tristrips", {}).values() if isinstance(column, tuple)]
    if not lists:
        return np.zeros((0, 3), np.int64)
    counts, index = lists[0]
    whole = index.astype(np.int64) if index.dtype.kind in "iu" else integers(index, "tristrips")
    ends = np.cumsum(counts)
    return strip_triangles(np.insert(whole, ends, -1))


def _check_others(tables: dict[str, Table], known: set[str]) -> None:
    """Raise MalformedError for an element with lists that we do not know: faces by another name are no cloud."""
    for name, table in tables.items():
        if name not in known and any(isinstance(column, tuple) and len(column[0]) for column in table.values()):
            raise MalformedError(
                f"{name}: expected faces in an element `face`, got an element of lists {', '.join(table)}; "
                "export the mesh as polygons"
            )


def _column(table: Table, name: str) -> np.ndarray:
    column = table[name]
    assert isinstance(column, np.ndarray)
    return column


def _colors(table: Table) -> np.ndarray | None:
    """(rows, 3) uint8 of the properties red green blue, or their other names."""
    for names in (("red", "green", "blue"), ("r", "g", "b"), ("diffuse_red", "diffuse_green", "diffuse_blue")):
        if all(isinstance(table.get(name), np.ndarray) for name in names):
            return to_uint8(np.stack([_column(table, name) for name in names], axis=1))
    return None


def _texture(
    surface: Surface, vertex: Table, face: Table, cut: Triangles, corners: int, images: list[bytes | None]
) -> None:
    """Corner or vertex texture coordinates with their images; else face colours as one material each."""
    decoded = [decode(image) if image else None for image in images]
    surface.materials = [Material(image=image) for image in decoded]
    surface.count("missing_textures", sum(image is None for image in decoded))
    strips = len(surface.faces) - len(cut.corners)
    texcoord = face.get("texcoord")
    if images and isinstance(texcoord, tuple) and len(texcoord[1]) == 2 * corners:
        of_corners = texcoord[1].astype(np.float64).reshape(-1, 2)[cut.corners]
        surface.face_uvs = np.concatenate([of_corners, np.full((strips, 3, 2), np.nan)])
    elif images:
        for names in (("texture_u", "texture_v"), ("u", "v"), ("s", "t")):
            if all(isinstance(vertex.get(name), np.ndarray) for name in names):
                of_vertices = np.stack([_column(vertex, name) for name in names], axis=1).astype(np.float64)
                surface.face_uvs = of_vertices[surface.faces]
                break
    if surface.face_uvs is not None:
        number = face.get("texnumber")
        of_face = np.zeros(len(surface.faces), np.int64)
        if isinstance(number, np.ndarray):
            of_face[: len(cut.polygon)] = integers(number.astype(np.float64), "texnumber")[cut.polygon]
        surface.face_materials = np.where((of_face >= 0) & (of_face < len(images)), of_face, -1)
    elif surface.vertex_colors is None and not strips and (face_colors := _colors(face)) is not None:
        surface.paint(face_colors[cut.polygon])
