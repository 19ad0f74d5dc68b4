"""What the readers give: a Surface (vertices, faces, colours) or a Cloud, in the source frame, before any cleaning."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

GREY = (178, 178, 178)
"""What has no colour of its own: the paper's grey .7."""


class MalformedError(ValueError):
    """What a reader found wrong in a file, in words that lack only the shape's name."""


@dataclass
class Material:
    """Diffuse appearance only: an image, or else one colour (sRGB), or neither."""

    color: tuple[int, int, int] | None = None
    image: np.ndarray | None = None
    """(h, w, 3) uint8 sRGB, first row on top."""


@dataclass
class Surface:
    """A polygon mesh as its file has it, polygons cut into fans of triangles."""

    vertices: np.ndarray
    """(v, 3) float64, source frame, in the file's order; may hold NaN."""
    faces: np.ndarray
    """(f, 3) int64, every index within the vertices."""
    vertex_colors: np.ndarray | None = None
    """(v, 3) uint8 sRGB."""
    materials: list[Material] = field(default_factory=list)
    face_materials: np.ndarray | None = None
    """(f,) int64 index into materials, -1 for none."""
    face_uvs: np.ndarray | None = None
    """(f, 3, 2) float64 texture coordinates of the corners, origin at the lower left, 1 = one repeat; NaN where
    absent."""
    problems: dict[str, int] = field(default_factory=dict)
    """What could not be read but does no harm, counted: missing_textures, …"""


@dataclass
class Cloud:
    """Points as their file has them."""

    points: np.ndarray
    """(n, 3) float64, source frame, in the file's order; may hold NaN."""
    colors: np.ndarray | None = None
    """(n, 3) uint8 sRGB."""
    repaired: int = 0
    """How many points were not finite and now lie on a neighbour."""


def fans(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cut polygons, given as runs of corners one after another, into fans of triangles.

    `counts` (p,): corners of each polygon; those with fewer than 3 give no triangle. Returns the corners of each
    triangle (t, 3), as indices into all corners, and the polygon of each triangle (t,).
    """
    triangles = np.maximum(counts - 2, 0)
    polygon = np.repeat(np.arange(len(counts)), triangles)
    first = (np.cumsum(counts) - counts)[polygon]
    step = np.arange(len(polygon)) - (np.cumsum(triangles) - triangles)[polygon]
    return np.stack([first, first + step + 1, first + step + 2], axis=1), polygon


def check_faces(faces: np.ndarray, vertices: int) -> None:
    """Raise MalformedError where a face names a vertex that does not exist, before anything else touches the
    indices."""
    wrong = ((faces < 0) | (faces >= vertices)).any(axis=1)
    if wrong.any():
        first = int(np.argmax(wrong))
        index = next(int(i) for i in faces[first] if not 0 <= i < vertices)
        raise MalformedError(
            f"face {first}: expected vertex indices from 0 to {vertices - 1}, "
            f"got {index} ({int(wrong.sum())} such faces); "
            "export the mesh again"
        )


def to_uint8(colors: np.ndarray) -> np.ndarray:
    """Colours as uint8: floats that stay within [0, 1] are scaled, integers and 0…255 floats kept; 16-bit integers
    shifted."""
    colors = np.nan_to_num(np.asarray(colors), nan=0.0, posinf=255.0, neginf=0.0)
    if colors.dtype == np.uint8:
        return colors
    if colors.dtype == np.uint16:
        return (colors >> 8).astype(np.uint8)
    if np.issubdtype(colors.dtype, np.floating) and colors.size and colors.max() <= 1:
        colors = colors * 255.0
    return np.clip(np.rint(colors), 0, 255).astype(np.uint8)


def unique_colors(colors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distinct colours (p, 3) uint8 among (n, 3) uint8, sorted, and which of them each is (n,) int64."""
    red, green, blue = (colors[:, i].astype(np.int64) for i in range(3))
    packed, which = np.unique(red << 16 | green << 8 | blue, return_inverse=True)
    return np.stack([packed >> 16, packed >> 8 & 255, packed & 255], axis=1).astype(np.uint8), which
