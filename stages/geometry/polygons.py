"""Polygons → triangles: fans where a fan covers the polygon, ears where it does not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.schemas.wording import counted
from b23d.stages.geometry.surface import MalformedError

FLAT = 1e-9
"""A fan's triangle may turn against its polygon by this share of the polygon's squared area: rounding, not a notch."""
EFFORT = 3e9
"""Sum of the squared corner counts of concave polygons, at most: ear clipping takes some 2 ns each where edges
cross."""


@dataclass
class Triangles:
    """Polygons cut into triangles, in the polygons' order."""

    corners: np.ndarray
    """(t, 3) int64 indices into all polygons' corners."""
    polygon: np.ndarray
    """(t,) int64, the polygon each is cut from."""
    concave: int
    """How many polygons a fan from the first corner would not have covered."""


def triangulate(vertices: np.ndarray, corners: np.ndarray, counts: np.ndarray) -> Triangles:
    """Cut polygons into triangles that cover them and turn the same way round.

    vertices (v, 3) float64; corners (c,) int64 within them, the polygons' runs of corners one after another; counts
    (p,): corners of each; those of fewer than 3 give no triangle. Polygons that are not flat are cut as seen along
    their mean normal. Raises MalformedError where concave polygons have too many corners to be cut in seconds.
    """
    fan, polygon = fans(counts)
    concave, normals = _concave(vertices, corners[fan], polygon, counts)
    if not len(concave):
        return Triangles(fan, polygon, 0)
    if (counts[concave].astype(np.float64) ** 2).sum() > EFFORT:
        raise MalformedError(
            f"faces: expected concave polygons of some thousand corners at most, got one of {counts[concave].max()}; "
            "triangulate the mesh in another program"
        )
    starts = np.cumsum(counts) - counts
    pieces = [_ears(vertices[corners[starts[p] : starts[p] + counts[p]]], normals[p]) for p in concave]
    whole = ~np.isin(polygon, concave)
    cut = np.concatenate([starts[p] + piece for p, piece in zip(concave, pieces, strict=True)])
    cut_from = np.repeat(concave, [len(piece) for piece in pieces])
    together = np.concatenate([polygon[whole], cut_from])
    order = np.argsort(together, kind="stable")
    return Triangles(np.concatenate([fan[whole], cut])[order], together[order], len(concave))


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


def check_corners(
    corners: np.ndarray,
    counts: np.ndarray,
    vertices: int,
    lines: np.ndarray | None = None,
    written: np.ndarray | None = None,
    what: str = "face",
) -> None:
    """Raise MalformedError where a polygon names a vertex that does not exist, before anything uses the index.

    For the message, `lines`: the file's line of each polygon; None for a binary file. `written`: the corners as the
    file has them, where it counts from 1, or back from the end; None: as here, from 0. `what`: a polygon's name.
    """
    wrong = np.flatnonzero((corners < 0) | (corners >= vertices))
    if len(wrong):
        owners = np.searchsorted(np.cumsum(counts), wrong, side="right")
        where = f"line {lines[owners[0]]}: " if lines is not None else ""
        first, got = (0, corners[wrong[0]]) if written is None else (1, written[wrong[0]])
        named = f"an index from {first} to {vertices - 1 + first}" if vertices else "no face"
        raise MalformedError(
            f"{where}{what} {owners[0]}: expected {named}, as the file has {counted(vertices, 'vertex', 'vertices')}, "
            f"got {got} ({counted(len(np.unique(owners)), f'such {what}')}); export the mesh again"
        )


def _concave(
    vertices: np.ndarray, fan: np.ndarray, polygon: np.ndarray, counts: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Which polygons (k,) have a fan with a triangle that turns against them, and all polygons' area vectors (p, 3)."""
    normals = np.zeros((len(counts), 3))
    many = counts[polygon] > 3
    if not many.any():
        return np.zeros(0, np.int64), normals
    fan, polygon = fan[many], polygon[many]
    with np.errstate(over="ignore", invalid="ignore"):  # coordinates may be anything; NaN compares as not concave
        first, second, third = (vertices[fan[:, i]] for i in range(3))
        turns = np.cross(second - first, third - first)
        for axis in range(3):
            normals[:, axis] = np.bincount(polygon, turns[:, axis], minlength=len(counts))
        squared = np.einsum("px,px->p", normals, normals)
        against = np.einsum("tx,tx->t", turns, normals[polygon]) < -FLAT * squared[polygon]
    return np.unique(polygon[against]), normals


def _ears(points: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """One polygon (c, 3) cut into triangles (t, 3), seen along `normal`."""
    from mapbox_earcut import triangulate_float64

    normal = normal / np.abs(normal).max()
    normal /= np.linalg.norm(normal)
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    flat = (points - points[0]) @ np.stack([across, np.cross(normal, across)], axis=1)
    flat /= np.abs(flat).max()
    cut = triangulate_float64(np.ascontiguousarray(flat), np.array([len(flat)], np.uint32)).reshape(-1, 3)
    if not len(cut):
        return fans(np.array([len(points)]))[0]
    cut = cut.astype(np.int64)
    (ux, uy), (vx, vy) = (flat[cut[:, 1]] - flat[cut[:, 0]]).T, (flat[cut[:, 2]] - flat[cut[:, 0]]).T
    clockwise = ux * vy < uy * vx
    cut[clockwise] = cut[clockwise][:, ::-1]
    return cut
