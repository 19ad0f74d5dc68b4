"""Dirty geometry → clean faces and a unit frame, vertices kept; every repair is counted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

THIN = float(2.0**-23)
"""A face whose height is at most this part of the shape's longest side is degenerate: float32 cannot tell it from a
line."""


@dataclass
class Frame:
    """The unit frame: `unit = (source - center) / scale` brings the bounding box's centre to 0 and its longest side to
    1."""

    center: np.ndarray
    """(3,) float64, source frame."""
    scale: float

    def unit(self, points: np.ndarray) -> np.ndarray:
        """Source frame (n, 3) → unit frame, float64."""
        with np.errstate(over="ignore", invalid="ignore"):  # vertices that no face uses may be anywhere
            return (points - self.center) / self.scale

    @classmethod
    def around(cls, points: np.ndarray) -> Frame:
        """The unit frame of finite points (n, 3); n ≥ 1. `scale` is 0 for a single place, inf beyond float64."""
        axes = np.ascontiguousarray(points.T)  # numpy reduces along the long axis some 20 times faster
        low, high = axes.min(axis=1), axes.max(axis=1)
        with np.errstate(over="ignore"):
            return cls(low / 2 + high / 2, float((high - low).max()))


@dataclass
class Clean:
    """A surface after cleaning."""

    vertices: np.ndarray
    """(v, 3) float32, unit frame, all finite: those that were not are at the centre."""
    faces: np.ndarray
    """(f, 3) int32."""
    kept: np.ndarray
    """(f,) int64: which of the given faces they are, ascending."""
    frame: Frame
    repairs: dict[str, int]


def clean(vertices: np.ndarray, faces: np.ndarray, shape: str) -> Clean:
    """Drop faces that are non-finite, degenerate (a corner repeated, or no height) or duplicate (the same three places
    as an earlier face, either way round), and find the unit frame of what remains.

    `vertices` (v, 3) float64, source frame; `faces` (f, 3) int64 within them. Raises ValueError with the shape's name
    where no face remains or the box has no finite extent.
    """
    a, b, c = faces.T
    finite = finite_rows(vertices)
    usable = finite[a] & finite[b] & finite[c]
    distinct = (a != b) & (b != c) & (c != a)
    candidates = np.flatnonzero(usable & distinct)
    if not len(candidates):
        raise _no_area(shape, len(faces), "degenerate or non-finite")

    frame, solid = _solid(vertices, faces, candidates, shape)
    placed = _placed(vertices, finite, frame)
    kept = solid[_first_of_its_kind(placed, faces[solid])]
    referenced = _used(faces[kept], len(vertices))
    repairs = {
        "unreferenced_vertices": int((finite & ~referenced).sum()),
        "degenerate_faces": int(usable.sum()) - len(solid),
        "duplicate_faces": len(solid) - len(kept),
        "non_finite_vertices": int((~finite).sum()),
        "non_finite_faces": int((~usable).sum()),
    }
    return Clean(placed, faces[kept].astype(np.int32), kept, frame, repairs)


def _solid(vertices: np.ndarray, faces: np.ndarray, candidates: np.ndarray, shape: str) -> tuple[Frame, np.ndarray]:
    """Which candidates (positions, ascending) have a height, and the frame of their corners. Raises ValueError where
    none has."""

    def around(some: np.ndarray) -> Frame:
        return check_frame(Frame.around(vertices[_used(faces[some], len(vertices))]), shape)

    def tall(frame: Frame) -> np.ndarray:
        return candidates[heights(frame.unit(vertices), faces[candidates]) > THIN]

    frame = around(candidates)
    solid = tall(frame)
    if not len(solid):
        raise _no_area(shape, len(faces), "degenerate")
    # A face of no height may have reached far out: measure heights again in the frame of what has some.
    inner = around(solid)
    if inner.scale < frame.scale:
        solid = tall(inner)
    return around(solid), solid


def _no_area(shape: str, faces: int, how: str) -> ValueError:
    return ValueError(
        f"{shape}: expected faces with an area, got {faces} that are all {how}; restore the mesh or remove the shape"
    )


def _placed(vertices: np.ndarray, finite: np.ndarray, frame: Frame) -> np.ndarray:
    """Vertices (v, 3) float32, unit frame; at the centre what is not finite, or (used by no face) too far for
    float32."""
    placed = np.zeros((len(vertices), 3), np.float32)
    with np.errstate(over="ignore"):
        placed[finite] = frame.unit(vertices[finite])
    placed[~finite_rows(placed)] = 0
    return placed


def check_frame(frame: Frame, shape: str) -> Frame:
    """The frame itself. Raises ValueError where it has no extent, or one too large or too small for floating point."""
    if frame.scale == 0:
        raise ValueError(
            f"{shape}: expected at least 2 distinct points, got all in one place; restore the file or remove the shape"
        )
    if not np.isfinite(frame.scale) or frame.scale < 1e-150 or frame.scale > 1e150:
        raise ValueError(
            f"{shape}: expected a finite extent, got {frame.scale:g}; look for stray coordinates and export it again"
        )
    return frame


def fill_gaps(points: np.ndarray) -> np.ndarray:
    """Points (n, 3) with each non-finite one put where the finite one nearest to it in the file's order is.

    So indices stay valid, and no candidate lies off the shape. At least one point must be finite.
    """
    finite = np.flatnonzero(finite_rows(points))
    if len(finite) == len(points):
        return points
    every = np.arange(len(points))
    next_one = np.minimum(np.searchsorted(finite, every), len(finite) - 1)
    after = finite[next_one]
    before = finite[np.maximum(next_one - 1, 0)]
    nearest = np.where(np.abs(before - every) <= np.abs(after - every), before, after)
    return points[nearest]


def finite_rows(points: np.ndarray) -> np.ndarray:
    """Which of the points (n, 3) have three finite coordinates: (n,) bool."""
    finite = np.isfinite(points)
    return finite[:, 0] & finite[:, 1] & finite[:, 2]


def areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Area of each face, (f,) float64, in the vertices' unit squared."""
    a, b, c = (vertices[faces[:, i]].astype(np.float64) for i in range(3))
    normal = np.cross(b - a, c - a)
    return np.sqrt(np.einsum("fx,fx->f", normal, normal)) / 2


def heights(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The shortest height of each face, (f,): twice its area by its longest side. vertices (v, 3) float64."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    sides = (a - b, b - c, c - a)
    squared = [np.einsum("fx,fx->f", side, side) for side in sides]
    longest = np.sqrt(np.maximum.reduce(squared))
    return 2 * areas(vertices, faces) / np.maximum(longest, np.finfo(np.float64).tiny)


def _used(faces: np.ndarray, vertices: int) -> np.ndarray:
    """Which vertices some face uses: (v,) bool."""
    used = np.zeros(vertices, bool)
    used[faces] = True
    return used


def _first_of_its_kind(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Positions, ascending, of the faces whose set of three places no earlier face has."""
    corners = np.sort(_places(vertices)[faces], axis=1)
    order = np.lexsort(corners.T)  # stable: equals stay in the file's order
    ordered = corners[order]
    new = np.concatenate([[True], _changes(ordered)])
    return np.sort(order[new])


def _places(vertices: np.ndarray) -> np.ndarray:
    """A number for each vertex (v,) int64 that two vertices share if they lie in the very same place."""
    order = np.lexsort(vertices.T)
    ordered = vertices[order]
    new = np.concatenate([[False], _changes(ordered)])
    place = np.empty(len(vertices), np.int64)
    place[order] = np.cumsum(new)
    return place


def _changes(rows: np.ndarray) -> np.ndarray:
    """Which of the rows (n, 3), from the second on, differ from the one before: (n - 1,) bool."""
    differ = rows[1:] != rows[:-1]
    return differ[:, 0] | differ[:, 1] | differ[:, 2]
