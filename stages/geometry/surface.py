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
    """A polygon mesh as its file has it, polygons cut into triangles."""

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

    def count(self, what: str, times: int) -> None:
        """Add to `problems`; nothing where there is nothing to tell."""
        if times:
            self.problems[what] = self.problems.get(what, 0) + times

    def paint(self, colors: np.ndarray) -> None:
        """One plain material for each of the faces' colours (f, 3) uint8."""
        palette, self.face_materials = unique_colors(colors)
        self.materials = [Material(color=(int(r), int(g), int(b))) for r, g, b in palette]


@dataclass
class Cloud:
    """Points as their file has them."""

    points: np.ndarray
    """(n, 3) float64, source frame, in the file's order; may hold NaN."""
    colors: np.ndarray | None = None
    """(n, 3) uint8 sRGB."""
    repaired: int = 0
    """How many points were not finite and now lie on a neighbour."""
    problems: dict[str, int] = field(default_factory=dict)
    """As a Surface's."""


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
