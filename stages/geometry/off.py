"""OFF and its coloured kin (COFF, NOFF, CNOFF …). Our own reader because trimesh's fails on faces of mixed size."""

from __future__ import annotations

import re

import numpy as np

from b23d.stages.geometry.surface import Cloud, MalformedError, Surface, check_faces, fans, to_uint8
from b23d.stages.geometry.text import integers, numbers, plain, tokens_per_line, uncommented


def read_off(data: bytes, colors: bool) -> Surface | Cloud:
    """The mesh of an OFF, vertices in the file's order; a Cloud where it has no faces. Raises MalformedError."""
    text = b"\n".join(line for line in uncommented(plain(data)).split(b"\n") if line.strip()) + b"\n"
    head = re.match(rb"(ST)?(C?)(N?)OFF\s*(\d+)\s+(\d+)(?:\s+\d+)?[^\n]*\n", text)  # ModelNet writes `OFF490 518 0`
    if head is None:
        raise MalformedError(
            "header: expected `OFF` and the counts of vertices and faces, got something else; export the mesh again"
        )
    texture, color, normal = head.group(1), head.group(2), head.group(3)
    rows, polygons = int(head.group(4)), int(head.group(5))
    text = text[head.end() :]
    widths = tokens_per_line(text)
    if len(widths) < rows + polygons or (widths[:rows] < 3).any():
        raise MalformedError(
            f"data: expected {rows} vertices and {polygons} faces, got {len(widths)} lines; copy or export it again"
        )
    values = numbers(text, "data")
    starts = np.cumsum(widths) - widths

    vertices = values[starts[:rows, None] + np.arange(3)] if rows else np.zeros((0, 3))
    vertex_colors = None
    before = 3 + 3 * bool(normal)
    if color and colors and rows and (widths[:rows] >= before + 3 + 2 * bool(texture)).all():
        vertex_colors = to_uint8(values[starts[:rows, None] + before + np.arange(3)])
    if not polygons:
        return Cloud(vertices, vertex_colors)

    at = starts[rows : rows + polygons]
    counts = integers(values[at], "faces")
    if (counts < 0).any() or (counts + 1 > widths[rows : rows + polygons]).any():
        raise MalformedError(
            "faces: expected the number of corners and then that many indices, got fewer; export the mesh again"
        )
    within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    index = integers(values[np.repeat(at + 1, counts) + within], "faces")
    triangles, _ = fans(counts)
    surface = Surface(vertices, index[triangles], vertex_colors)
    check_faces(surface.faces, len(vertices))
    return surface
