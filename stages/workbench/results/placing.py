"""Where predicted keypoints are in a shape's own file: coordinates, nearest vertex, face and barycentrics."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from b23d.pipeline.dataset import Shape
from b23d.schemas.shape import NormalizedShape, Source
from b23d.stages.geometry.loading import load
from b23d.stages.geometry.surface import Surface

DROPPING = ("degenerate_faces", "duplicate_faces", "non_finite_faces")
"""Repairs that leave out faces of the file."""


@dataclass(frozen=True)
class SurfacePlace:
    """A place on a shape, as its file counts."""

    position: tuple[float, float, float]
    """Source frame."""
    vertex: int | None = None
    face: int | None = None
    barycentrics: tuple[float, float, float] | None = None

    def columns(self) -> dict[str, float | int | None]:
        x, y, z = self.position
        b = self.barycentrics or (None, None, None)
        return {
            "x": x, "y": y, "z": z, "vertex": self.vertex, "face": self.face, "b0": b[0], "b1": b[1], "b2": b[2],
        }  # fmt: skip


class Placer:
    """One shape, asked for many candidates."""

    def __init__(self, shape: Shape, normalized: NormalizedShape) -> None:
        self.shape, self.normalized = shape, normalized
        self.own = "watertight_faces" not in normalized.repairs
        """Whether vertices and faces are the file's."""

    def place(self, candidates: np.ndarray, positions: np.ndarray) -> Iterator[SurfacePlace]:
        """The places of `candidates` (k,), which lie at `positions` (k, 3) in the unit frame."""
        shape = self.normalized
        file = shape.to_source(positions.astype(np.float64))
        if not self.own or not len(candidates):
            yield from (SurfacePlace(_three(at)) for at in file)
            return
        vertices = self._vertices[self._tree.query(positions.astype(np.float64))[1]]
        faces, barycentrics = shape.point_faces[candidates], shape.point_barycentrics[candidates]
        for at, vertex, face, b in zip(file, vertices.tolist(), faces.tolist(), barycentrics, strict=True):
            yield SurfacePlace(_three(at), vertex, *((None, None) if face < 0 else (self._file_face(face), _three(b))))

    @cached_property
    def _vertices(self) -> np.ndarray:
        """Vertices that faces use: others may lie anywhere."""
        if self.normalized.kind == "cloud":
            return np.arange(len(self.normalized.vertices))
        return np.unique(self.normalized.faces)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.normalized.vertices[self._vertices].astype(np.float64))

    def _file_face(self, face: int) -> int | None:
        """The file's number of a clean face: the first with its very corners; None where the file is gone by now."""
        if self._file_faces is None:
            return face
        same = np.flatnonzero((self._file_faces == self.normalized.faces[face]).all(axis=1))
        return int(same[0]) if len(same) else None

    @cached_property
    def _file_faces(self) -> np.ndarray | None:
        """(f, 3) the file's triangles, where cleaning has left some out; None where it has kept all, in order."""
        if not any(self.normalized.repairs.get(name) for name in DROPPING):
            return None
        try:
            source = self.shape.leaves["source"].read()
            assert isinstance(source, Source) and source.mesh is not None
            surface = load(source.shape, source.files, source.mesh, colors=False)
        except (OSError, ValueError):
            return np.zeros((0, 3), np.int64)
        return surface.faces if isinstance(surface, Surface) else np.zeros((0, 3), np.int64)


def _three(values: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z
