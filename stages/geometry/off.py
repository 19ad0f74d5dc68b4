"""OFF and its coloured kin (COFF, NOFF, CNOFF, STOFF …). Our own reader because trimesh's fails on faces of mixed
size."""

from __future__ import annotations

import re

import numpy as np

from b23d.schemas.wording import counted
from b23d.stages.geometry.polygons import check_corners, triangulate
from b23d.stages.geometry.surface import Cloud, MalformedError, Surface, to_uint8
from b23d.stages.geometry.text import integers, numbers, plain, tokens_per_line, uncommented, without_commas

HEAD = re.compile(rb"\s*(ST)?(C)?(N)?(4)?OFF(?![a-z])[^\S\n]*(BINARY)?", re.IGNORECASE)
COUNTS = re.compile(rb"\s*(\d+)[\s,]+(\d+)(?:[ ,]+\d+)* *\n")
"""Vertices, faces and, on the same line, edges, which many programs leave out."""


def read_off(data: bytes, colors: bool) -> Surface | Cloud:
    """The mesh of an OFF, vertices in the file's order; a Cloud where it has no faces. Raises MalformedError.

    Lines behind the faces that are no faces are counted in `problems`.
    """
    text = uncommented(plain(data))
    head = HEAD.match(text)
    if head is None or head[5] or b"nOFF" in head[0]:  # binary, or of other dimensions
        got = text[:20].split(b"\n")[0].decode("utf-8", "replace") if head is None else head[0].strip().decode()
        raise MalformedError(
            f"line 1: expected `OFF`, the counts of vertices and faces, and text, got {got!r}; export the mesh again"
        )
    texture, color, normal, homogeneous = (head[i] is not None for i in (1, 2, 3, 4))
    counts = COUNTS.match(text, head.end())  # ModelNet writes `OFF490 518 0`
    if counts is None:
        line = text.count(b"\n", 0, head.end()) + 1
        raise MalformedError(
            f"line {line}: expected the counts of vertices and faces, got something else; export the mesh again"
        )
    rows, polygons = int(counts[1]), int(counts[2])
    first = text.count(b"\n", 0, counts.end()) + 1
    lines = np.arange(first, first + text.count(b"\n", counts.end()))
    text = without_commas(text[counts.end() :], "data", lines)
    widths = tokens_per_line(text)
    lines, full = lines[widths > 0], widths[widths > 0]
    if len(full) < rows + polygons:
        raise MalformedError(
            f"data: expected {counted(rows, 'vertex', 'vertices')} and {counted(polygons, 'face')}, "
            f"got {counted(len(full), 'line')}; copy or export it again"
        )
    places = 3 + homogeneous
    _check_widths(full[:rows], places, lines)
    last = np.flatnonzero(widths)[rows + polygons - 1] + 1 if rows + polygons else 0
    behind = text.split(b"\n", last)[-1] if len(full) > rows + polygons else b""
    text, full = text[: len(text) - len(behind)], full[: rows + polygons]
    values = numbers(text, "data", np.arange(first, first + len(widths)))
    if len(values) != full.sum():
        raise MalformedError("data: expected numbers with blanks between, got others; export the mesh again")
    starts = np.cumsum(full) - full

    vertices = values[starts[:rows, None] + np.arange(3)] if rows else np.zeros((0, 3))
    if homogeneous and rows:
        with np.errstate(divide="ignore", invalid="ignore"):
            vertices = vertices / values[starts[:rows] + 3][:, None]
    vertex_colors = None
    before = places + 3 * normal
    if color and colors and rows and (full[:rows] >= before + 3 + 2 * texture).all():
        vertex_colors = to_uint8(values[starts[:rows, None] + before + np.arange(3)])
    if not polygons:
        return Cloud(vertices, vertex_colors)

    at, lines_of_faces = starts[rows : rows + polygons], lines[rows : rows + polygons]
    sizes = integers(values[at], "faces")
    short = np.flatnonzero((sizes < 0) | (sizes + 1 > full[rows : rows + polygons]))
    if len(short):
        raise MalformedError(
            f"line {lines_of_faces[short[0]]}: face {short[0]}: expected the number of corners and then that many "
            f"indices, got {sizes[short[0]]} and {full[rows + short[0]] - 1}; export the mesh again"
        )
    within = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
    index = integers(values[np.repeat(at + 1, sizes) + within], "faces")
    check_corners(index, sizes, len(vertices), lines_of_faces)
    cut = triangulate(vertices, index, sizes)
    surface = Surface(vertices, index[cut.corners], vertex_colors)
    surface.count("concave_polygons", cut.concave)
    colored = full[rows : rows + polygons] - sizes - 1
    if colors and vertex_colors is None and (colored >= 3).all():
        surface.paint(to_uint8(values[(at + sizes + 1)[:, None] + np.arange(3)])[cut.polygon])
    surface.count("trailing_lines", _trailing(behind, rows, polygons, lines))
    return surface


def _check_widths(widths: np.ndarray, places: int, lines: np.ndarray) -> None:
    """Raise MalformedError where a vertex has too few numbers, or not as many as the others."""
    short = np.flatnonzero((widths < places) | (widths != (np.bincount(widths).argmax() if len(widths) else 0)))
    if len(short):
        expected = max(places, int(np.bincount(widths).argmax()))
        raise MalformedError(
            f"line {lines[short[0]]}: vertex {short[0]}: expected {counted(expected, 'number')}, "
            f"got {widths[short[0]]}; export the mesh again"
        )


def _trailing(text: bytes, rows: int, polygons: int, lines: np.ndarray) -> int:
    """How many lines stand behind the faces. Raises MalformedError where the first looks like one more face."""
    more = [line for line in text.split(b"\n") if line.strip()]
    words = more[0].split() if more else []
    corners = words[1 : 1 + int(words[0])] if words and words[0].isdigit() and len(words[0]) < 9 else []
    if 3 <= len(corners) == int(words[0]) and all(word.isdigit() and int(word) < rows for word in corners):
        raise MalformedError(
            f"line {lines[rows + polygons]}: expected the end after {counted(polygons, 'face')}, as the header says, "
            "got another face; export the mesh again"
        )
    return len(more)
