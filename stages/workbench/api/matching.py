"""`b23d.match`: for every vertex of one shape the point of another that looks alike, and the other's colours on it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from b23d.schemas.shape import NormalizedShape
from b23d.stages.correspondence.matching import Method, check_method, correspond
from b23d.stages.correspondence.surfaces import FeaturedSurface, centred, unit
from b23d.stages.workbench.api.arguments import path_of
from b23d.stages.workbench.api.features import DescribedShape, describe
from b23d.stages.workbench.pictures.frames import in_frame, sampled
from b23d.stages.workbench.pictures.solids import SceneObject, write_glb, write_ply

if TYPE_CHECKING:
    import trimesh

CHUNK = 4096
"""Vertices compared at a time."""


@dataclass(frozen=True)
class Match:
    """Where each vertex of a, in its own order, finds its like on b."""

    a: NormalizedShape
    b: NormalizedShape
    points: np.ndarray
    """(v, 3) float64 on b, in b's own coordinates."""
    similarity: np.ndarray
    """(v,) float32: cosine of the two descriptors, each less its shape's mean; -1 … 1."""
    colors: np.ndarray
    """(v, 3) uint8: b's colours at `points`, its texture's where it has one, by place where it has none."""
    candidate_colors: np.ndarray
    """(n, 3) uint8: the same colours at b's own candidates."""

    def mesh(self) -> trimesh.Trimesh | trimesh.PointCloud:
        """a in its own coordinates with b's colours."""
        import trimesh

        vertices = in_frame(self.a.vertices, self.a, "file")
        if self.a.kind == "cloud":
            return trimesh.PointCloud(vertices, colors=self.colors)
        return trimesh.Trimesh(vertices, self.a.faces, vertex_colors=self.colors, process=False)

    def write(self, path: str | Path) -> None:
        """a with b's colours as .ply (with the scalars `similarity`, `bx`, `by`, `bz`) or .glb. Raises ValueError for
        another suffix."""
        path = path_of("path", path, "a file of .ply or .glb")
        suffix = path.suffix.lower()
        if suffix not in (".ply", ".glb"):
            raise ValueError(f"match: expected a file of .ply or .glb, got {path.name!r}; change its name")
        x, y, z = self.points.T.astype(np.float32)
        scalars = {"similarity": self.similarity, "bx": x, "by": y, "bz": z}
        part = SceneObject("a", in_frame(self.a.vertices, self.a, "file"), self.colors, self.a.faces, scalars)
        path.parent.mkdir(parents=True, exist_ok=True)
        if suffix == ".ply":
            write_ply(part, path, ["a with b's colours; bx by bz: the matching point of b, in b's coordinates"])
        else:
            write_glb([part], path)


def match(
    a: Any,
    b: Any,
    *,
    method: Method = "nearest",
    encoder: str | None = None,
    overrides: Iterable[str] = (),
    store: str | None = None,
) -> Match:
    """For each vertex of a (point, where it is a cloud) a candidate of b.

    a, b and the other arguments as `b23d.features` takes them. Descriptors are centred by each shape's own mean, since
    what two shapes differ in as wholes tells nothing of their parts.

    method "nearest": the most alike descriptor; left and right of a symmetric shape look alike. "consistent" and
    "smooth" also keep mutual distances and tell left from right, candidate by candidate of a; "smooth" makes one smooth
    map of it, for two poses or builds of one kind of body. Raises as `b23d.features`, and ValueError for other methods.
    """
    check_method(method)
    first, second = describe({"a": a, "b": b}, encoder, overrides, store, distances=method != "nearest")
    own = candidate_colors(second.shape)
    names = tuple(str(thing) if isinstance(thing, str | Path) else name for name, thing in (("a", a), ("b", b)))
    nearest, similarity = alike(first, second) if method == "nearest" else carried(first, second, method, names)
    points = in_frame(second.shape.points[nearest], second.shape, "file")
    return Match(first.shape, second.shape, points, similarity, own[nearest], own)


def alike(a: DescribedShape, b: DescribedShape) -> tuple[np.ndarray, np.ndarray]:
    """(v,) the candidate of b whose descriptor is nearest to that of each vertex of a, and their cosine."""
    mean_a = a.features.features.mean(axis=0, dtype=np.float32)
    theirs = centred(b.features.features)
    vertices = a.shape.vertices
    nearest, similarity = np.zeros(len(vertices), np.int64), np.zeros(len(vertices), np.float32)
    for start in range(0, len(vertices), CHUNK):
        rows = slice(start, start + CHUNK)
        cosine = unit(a.at(vertices[rows]) - mean_a) @ theirs.T
        nearest[rows] = cosine.argmax(axis=1)
        similarity[rows] = cosine.max(axis=1)
    return nearest, similarity


def carried(
    a: DescribedShape, b: DescribedShape, method: Method, names: tuple[str, ...] = ("a", "b")
) -> tuple[np.ndarray, np.ndarray]:
    """(v,) the candidate of b that the candidate of a nearest to each vertex corresponds to, and their cosine.

    `names`: of a and b, for messages.
    """
    from scipy.spatial import cKDTree

    matched = correspond(_surface(a, names[0]), _surface(b, names[1]), method)
    theirs = centred(b.features.features)[matched]
    similarity = (centred(a.features.features) * theirs).sum(axis=1)
    at = cKDTree(a.shape.points).query(a.shape.vertices)[1]
    return matched[at], similarity[at]


def _surface(described: DescribedShape, name: str) -> FeaturedSurface:
    assert described.distances is not None
    return FeaturedSurface(described.shape.points, described.features.features, described.distances, name)


def candidate_colors(shape: NormalizedShape) -> np.ndarray:
    """(n, 3) uint8 of the candidates: of the texture, of the vertices, or of their place where the shape has no
    colours."""
    faces, b = shape.point_faces, shape.point_barycentrics
    if shape.texture is not None and shape.face_uvs is not None:
        return sampled(shape.texture, np.einsum("nc,ncx->nx", b, shape.face_uvs[faces]))
    if shape.vertex_colors is not None and shape.kind == "mesh":
        mixed = np.einsum("nc,ncx->nx", b, shape.vertex_colors[shape.faces[faces]].astype(np.float32))
        return np.rint(mixed).astype(np.uint8)
    if shape.vertex_colors is not None:
        from scipy.spatial import cKDTree

        return shape.vertex_colors[cKDTree(shape.vertices).query(shape.points)[1]]
    low, side = shape.points.min(axis=0), np.ptp(shape.points, axis=0)
    return np.rint(255 * (shape.points - low) / np.maximum(side, 1e-9)).astype(np.uint8)
