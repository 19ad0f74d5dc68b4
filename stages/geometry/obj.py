"""Wavefront OBJ and MTL. Our own reader because keypoint indices count `v` lines: trimesh splits a mesh by material and
by texture seam, and renumbers its vertices."""

from __future__ import annotations

import posixpath

import numpy as np

from b23d.stages.geometry.companions import image_name, material_files, relative
from b23d.stages.geometry.images import decode, find
from b23d.stages.geometry.surface import Cloud, MalformedError, Material, Surface, check_faces, fans, to_uint8
from b23d.stages.geometry.text import corners, numbers, plain, tokens_per_line, uncommented

Lines = tuple[np.ndarray, np.ndarray, np.ndarray]
"""All bytes (uint8), and where each line begins and ends (its line end included)."""


def read_obj(data: bytes, files: dict[str, bytes], colors: bool) -> Surface | Cloud:
    """The mesh of an OBJ, vertices in the order of its `v` lines; a Cloud where it has no `f` line.

    `files` holds the MTLs and images by name relative to the OBJ; what is missing is counted in `problems`.
    Raises MalformedError.
    """
    text = plain(data)
    if b"\\\n" in text:
        text = text.replace(b"\\\n", b" ")
    buffer = np.frombuffer(text, np.uint8)
    ends = np.flatnonzero(buffer == 10) + 1
    begins = np.concatenate([[0], ends[:-1]])
    lines = (buffer, begins, ends)
    first, second = buffer[begins], buffer[np.minimum(begins + 1, len(buffer) - 1)]
    is_vertex = (first == ord("v")) & (second == ord(" "))
    is_uv = (first == ord("v")) & (second == ord("t"))
    is_face = (first == ord("f")) & (second == ord(" "))

    vertices, vertex_colors = _vertices(_block(lines, is_vertex))
    if not is_face.any():
        return Cloud(vertices, vertex_colors)
    uvs = _uvs(_block(lines, is_uv)) if colors and is_uv.any() else np.zeros((0, 2))

    block = _block(lines, is_face)
    counts = tokens_per_line(block)
    index, uv_index = corners(block, "faces")
    polygon_line = np.flatnonzero(is_face)
    line_of_corner = np.repeat(polygon_line, counts)
    index = _absolute(index, np.cumsum(is_vertex)[line_of_corner])
    uv_index = _absolute(uv_index, np.cumsum(is_uv)[line_of_corner])
    triangles, polygon = fans(counts)
    surface = Surface(vertices, index[triangles])
    if (counts < 3).any():
        surface.problems["polygons_of_one_or_two"] = int((counts < 3).sum())
    check_faces(surface.faces, len(vertices))
    if colors:
        surface.vertex_colors = vertex_colors
        has_uv = ((uv_index >= 0) & (uv_index < len(uvs)))[triangles].all(axis=1)
        if has_uv.any():
            surface.face_uvs = np.full((len(triangles), 3, 2), np.nan)
            surface.face_uvs[has_uv] = uvs[uv_index[triangles[has_uv]]]
        _materials(surface, text, lines, first == ord("u"), polygon_line[polygon], files)
    return surface


def _block(lines: Lines, chosen: np.ndarray) -> bytes:
    """The chosen lines without their keywords and comments, as one text."""
    buffer, begins, ends = lines
    block = buffer[np.repeat(chosen, ends - begins)]
    lengths = (ends - begins)[chosen]
    starts = np.cumsum(lengths) - lengths
    block[starts] = ord(" ")
    if len(starts) and block[starts[0] + 1] == ord("t"):
        block[starts + 1] = ord(" ")
    return uncommented(block.tobytes())


def _vertices(block: bytes) -> tuple[np.ndarray, np.ndarray | None]:
    """(v, 3) positions and (v, 3) colours from `x y z`, `x y z w`, `x y z r g b` or `x y z w r g b` lines."""
    counts = tokens_per_line(block)
    values = numbers(block, "vertices")
    if len(values) != counts.sum() or (counts < 3).any():
        bad = int(np.argmax(counts < 3))
        raise MalformedError(
            f"vertex {bad}: expected 3 coordinates, got {counts[bad] if len(counts) else 0}; export the mesh again"
        )
    starts = np.cumsum(counts) - counts
    positions = values[starts[:, None] + np.arange(3)]
    if not len(counts) or (counts < 6).any():
        return positions, None
    return positions, to_uint8(values[(starts + counts)[:, None] - np.arange(3, 0, -1)])


def _uvs(block: bytes) -> np.ndarray:
    counts = tokens_per_line(block)
    values = numbers(block, "texture coordinates")
    if len(values) != counts.sum() or (counts < 1).any():
        raise MalformedError("texture coordinates: expected `vt u v` lines, got an empty one; export the mesh again")
    starts = np.cumsum(counts) - counts
    v = np.where(counts > 1, values[np.minimum(starts + 1, len(values) - 1)], 0.0)
    return np.stack([values[starts], v], axis=1)


def _absolute(index: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Zero-based indices from OBJ's: 1 is the first, -1 the last one `seen` before that line; 0 means none and becomes
    -1."""
    absolute = np.where(index < 0, seen + index, index - 1)
    return np.where((index < 0) & (absolute < 0), -(2**40), absolute)  # before the first: keep it out of range


def _materials(
    surface: Surface, text: bytes, lines: Lines, chosen: np.ndarray, face_line: np.ndarray, files: dict[str, bytes]
) -> None:
    """Set materials and face_materials from the `usemtl` lines and the MTL files."""
    _, begins, ends = lines
    uses = [line for line in np.flatnonzero(chosen) if text.startswith(b"usemtl", begins[line])]
    if not uses:
        return
    names = [text[begins[line] + len(b"usemtl") : ends[line]].strip() for line in uses]
    known: dict[bytes, Material] = {}
    for mtl_name in material_files(text):
        mtl = find(files, mtl_name)
        if mtl is None:
            surface.problems["missing_material_files"] = surface.problems.get("missing_material_files", 0) + 1
        else:
            known.update(read_mtl(mtl, mtl_name, files, surface.problems))
    order = {name: i for i, name in enumerate(dict.fromkeys(names))}
    surface.materials = [known.get(name, Material()) for name in order]
    of_use = np.array([-1, *(order[name] for name in names)])
    surface.face_materials = of_use[np.searchsorted(uses, face_line)]


def read_mtl(data: bytes, mtl_name: str, files: dict[str, bytes], problems: dict[str, int]) -> dict[bytes, Material]:
    """The materials of an MTL file by name: `map_Kd`, else `Kd` (taken as sRGB, as most programs write it).

    An image that is absent or unreadable leaves `Kd`, and is counted in `problems`.
    """
    folder = posixpath.dirname(mtl_name)
    materials: dict[bytes, Material] = {}
    current = Material()
    for line in plain(data).split(b"\n"):
        key, _, rest = line.strip().partition(b" ")
        if key == b"newmtl":
            current = materials[rest.strip()] = Material()
        elif key == b"Kd" and rest.split()[:1] not in ([b"spectral"], [b"xyz"]):
            values = np.clip(numbers(uncommented(rest), "Kd")[:3], 0, 1)
            if len(values):
                red, green, blue = (round(float(v) * 255) for v in (values if len(values) == 3 else values[[0, 0, 0]]))
                current.color = (red, green, blue)
        elif key.lower() == b"map_kd":
            name = relative(folder, image_name(rest))
            image = find(files, name) if name else None
            current.image = decode(image) if image else None
            if current.image is None:
                problems["missing_textures"] = problems.get("missing_textures", 0) + 1
    return materials
