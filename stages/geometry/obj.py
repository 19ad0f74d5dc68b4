"""Wavefront OBJ. Our own reader because keypoint indices count `v` lines: trimesh splits a mesh by material and by
texture seam, and renumbers its vertices."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from b23d.schemas.wording import counted
from b23d.stages.geometry.companions import material_lines
from b23d.stages.geometry.images import find
from b23d.stages.geometry.mtl import read_mtl
from b23d.stages.geometry.polygons import check_corners, triangulate
from b23d.stages.geometry.surface import Cloud, MalformedError, Material, Surface, to_uint8
from b23d.stages.geometry.text import corners, numbers, plain, tokens_per_line, uncommented, without_commas

CAPITAL = np.uint8(ord("a") - ord("A"))
"""The bit that a capital letter lacks; a blank has it."""


@dataclass
class Lines:
    """An OBJ's text, line by line."""

    text: bytes
    buffer: np.ndarray
    """All bytes, uint8."""
    begins: np.ndarray
    """(lines,) int64, where each begins."""
    ends: np.ndarray
    """(lines,) int64, behind each line's end."""

    @classmethod
    def of(cls, data: bytes) -> Lines:
        text = plain(data)
        if b"\\\n" in text:  # a line goes on; empty lines behind it keep the count right
            text = re.sub(
                rb"(?:[^\n]*\\\n)+[^\n]*\n", lambda m: m[0].replace(b"\\\n", b" ") + b"\n" * m[0].count(b"\\\n"), text
            )
        buffer = np.frombuffer(text, np.uint8)
        ends = np.flatnonzero(buffer == 10) + 1
        return cls(text, buffer, np.concatenate([[0], ends[:-1]]), ends)

    def starting(self, keyword: bytes) -> np.ndarray:
        """Which lines begin with a keyword of one or two letters, small or capital, and a blank: (lines,) bool."""
        chosen = np.ones(len(self.begins), bool)
        for i, letter in enumerate(keyword + b" "):
            chosen &= self.buffer[np.minimum(self.begins + i, len(self.buffer) - 1)] | CAPITAL == letter
        return chosen

    def block(self, chosen: np.ndarray, what: str) -> KeywordLines:
        """The chosen lines without their keywords, comments and commas, as one text."""
        block = self.buffer[np.repeat(chosen, self.ends - self.begins)]
        lengths = (self.ends - self.begins)[chosen]
        starts = np.cumsum(lengths) - lengths
        block[starts] = ord(" ")
        if len(starts) and block[starts[0] + 1] | CAPITAL == ord("t"):
            block[starts + 1] = ord(" ")
        lines = np.flatnonzero(chosen) + 1
        text = without_commas(uncommented(block.tobytes()), what, lines)
        return KeywordLines(text, what, lines, tokens_per_line(text))


@dataclass
class KeywordLines:
    """The lines of one keyword, without it."""

    text: bytes
    what: str
    lines: np.ndarray
    """(lines,) int64, the file's number of each."""
    counts: np.ndarray
    """(lines,) int64, how many tokens each has."""

    def numbers(self, least: int) -> np.ndarray:
        """All numbers. Raises MalformedError where a line has fewer than `least`."""
        values = numbers(self.text, self.what, self.lines)
        short = np.flatnonzero(self.counts < least)
        if len(short):
            raise MalformedError(
                f"line {self.lines[short[0]]}: {self.what} {short[0]}: expected {counted(least, 'number')}, "
                f"got {self.counts[short[0]]}; export the mesh again"
            )
        if len(values) != self.counts.sum():
            raise MalformedError(
                f"{self.what}: expected numbers with blanks between, got others; export the mesh again"
            )
        return values


def read_obj(data: bytes, files: dict[str, bytes], colors: bool) -> Surface | Cloud:
    """The mesh of an OBJ, vertices in the order of its `v` lines; a Cloud where it has no `f` line.

    `files` holds the MTLs and images by name relative to the OBJ; what is missing is counted in `problems`.
    Raises MalformedError.
    """
    lines = Lines.of(data)
    is_vertex, is_uv, is_face = (
        lines.starting(b"v"),
        lines.starting(b"vt"),
        lines.starting(b"f") | lines.starting(b"fo"),
    )
    vertices, vertex_colors = _vertices(lines.block(is_vertex, "vertex"))
    if not is_face.any():
        return Cloud(vertices, vertex_colors)

    block = lines.block(is_face, "face")
    index, uv_index = corners(block.text, "face", block.lines)
    line_of_corner = np.repeat(np.flatnonzero(is_face), block.counts)
    written, index = index, _absolute(index, np.cumsum(is_vertex)[line_of_corner])
    check_corners(index, block.counts, len(vertices), block.lines, written)
    cut = triangulate(vertices, index, block.counts)
    surface = Surface(vertices, index[cut.corners])
    surface.count("polygons_of_one_or_two", int((block.counts < 3).sum()))
    surface.count("concave_polygons", cut.concave)
    if colors:
        surface.vertex_colors = vertex_colors
        uvs = _uvs(lines.block(is_uv, "texture coordinate")) if is_uv.any() else np.zeros((0, 2))
        uv_index = _absolute(uv_index, np.cumsum(is_uv)[line_of_corner])
        has_uv = ((uv_index >= 0) & (uv_index < len(uvs)))[cut.corners].all(axis=1)
        if has_uv.any():
            surface.face_uvs = np.full((len(cut.corners), 3, 2), np.nan)
            surface.face_uvs[has_uv] = uvs[uv_index[cut.corners[has_uv]]]
        _materials(surface, lines, np.flatnonzero(is_face)[cut.polygon], files)
    return surface


def _vertices(block: KeywordLines) -> tuple[np.ndarray, np.ndarray | None]:
    """(v, 3) positions and (v, 3) colours from `x y z`, `x y z w`, `x y z r g b` or `x y z w r g b` lines."""
    values, counts = block.numbers(least=3), block.counts
    starts = np.cumsum(counts) - counts
    positions = values[starts[:, None] + np.arange(3)] if len(counts) else np.zeros((0, 3))
    if not len(counts) or (counts < 6).any():
        return positions, None
    return positions, to_uint8(values[(starts + counts)[:, None] - np.arange(3, 0, -1)])


def _uvs(block: KeywordLines) -> np.ndarray:
    values, counts = block.numbers(least=1), block.counts
    starts = np.cumsum(counts) - counts
    v = np.where(counts > 1, values[np.minimum(starts + 1, len(values) - 1)], 0.0)
    return np.stack([values[starts], v], axis=1)


def _absolute(index: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Zero-based indices from OBJ's: 1 is the first, -1 the last one `seen` before that line; 0 means none and becomes
    -1."""
    absolute = np.where(index < 0, seen + index, index - 1)
    return np.where((index < 0) & (absolute < 0), -(2**40), absolute)  # before the first: keep it out of range


def _materials(surface: Surface, lines: Lines, face_line: np.ndarray, files: dict[str, bytes]) -> None:
    """Set materials and face_materials from the `usemtl` lines and the MTL files."""
    text = lines.text
    begins_with_u = lines.buffer[lines.begins] | CAPITAL == ord("u")
    key = len(b"usemtl")
    uses = [
        line
        for line in np.flatnonzero(begins_with_u)
        if text[(begin := lines.begins[line]) : begin + key].lower() == b"usemtl"
    ]
    if not uses:
        return
    names = [text[lines.begins[line] + key : lines.ends[line]].strip() for line in uses]
    known: dict[bytes, Material] = {}
    for whole, parts in material_lines(text):
        found: dict[bytes, Material] = {}
        for name in reversed([whole] if find(files, whole) is not None else parts):  # the first of a line wins
            mtl = find(files, name)
            if mtl is None:
                surface.count("missing_material_files", 1)
            else:
                found.update(read_mtl(mtl, name, files, surface.problems))
        known.update(found)
    order = {name: i for i, name in enumerate(dict.fromkeys(names))}
    if "missing_material_files" not in surface.problems:
        surface.count("missing_materials", len(order.keys() - known.keys()))
    surface.materials = [known.get(name, Material()) for name in order]
    of_use = np.array([-1, *(order[name] for name in names)])
    surface.face_materials = of_use[np.searchsorted(uses, face_line)]
