"""A shape to click on: what the page draws, and where on the shape a ray from the viewer lands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from b23d.schemas.shape import NormalizedShape, Source
from b23d.stages.geometry.cleaning import clean, fill_gaps
from b23d.stages.geometry.loading import load
from b23d.stages.geometry.nearest import nearest_on_faces
from b23d.stages.geometry.surface import Cloud, Surface
from b23d.stages.normalize import NormalizeParams, normalize
from b23d.stages.workbench.annotate.snapping import extremity as farthest_out
from b23d.stages.workbench.annotate.snapping import nearest_to_ray
from b23d.stages.workbench.pictures.surface import surface_of

DRAWN = 60_000
"""Faces that the page draws, about. Clicks are always measured on the mesh itself."""
BESIDE = 0.012
"""A ray hits the first point of a cloud that it passes at most this far from, unit frame."""
MISSED = 0.05
"""A ray that passes no point nearer than this hits nothing."""


@dataclass(frozen=True)
class Hit:
    """Where a click landed."""

    xyz: list[float]
    """Source frame, exactly on the surface, or a point of the cloud."""
    unit: list[float]
    normal: list[float]
    """Unit length, toward the viewer."""
    mesh_info: dict[str, Any] | None
    """`face_index`: of the file's faces, polygons cut into triangles; `face_uv`: barycentric coordinates."""
    pcd_info: dict[str, int] | None
    """`point_index` of the shape's cloud."""


@dataclass(frozen=True)
class Pickable:
    """A shape's geometry in the source frame."""

    drawn: NormalizedShape
    vertices: np.ndarray
    """(v, 3) float64, source frame; those of faces are finite."""
    faces: np.ndarray
    """(f, 3) int32, clean ones."""
    file_faces: np.ndarray
    """(f,) int64, which of the file's faces they are."""
    cloud: np.ndarray | None
    """(n, 3) float64, source frame, in the file's order."""

    @classmethod
    def load(cls, source: Source) -> Pickable:
        """Raises ValueError, naming the shape, where `normalize` does."""
        alone = NormalizeParams(candidates="fps", count=1)
        cloud = (
            load(source.shape, source.files, source.cloud, False, source.own_names)
            if source.cloud is not None
            else None
        )
        points = None if cloud is None else fill_gaps(cloud.points if isinstance(cloud, Cloud) else cloud.vertices)
        surface = (
            load(source.shape, source.files, source.mesh, False, source.own_names) if source.mesh is not None else None
        )
        if isinstance(surface, Surface):
            drawn = normalize(source.model_copy(update={"cloud": None}), alone)
            result = clean(surface.vertices, surface.faces, source.shape)
            return cls(drawn, surface.vertices, result.faces, result.kept, points)
        drawn = normalize(source, alone)
        if points is None and surface is not None:
            points = fill_gaps(surface.points)
        assert points is not None
        return cls(drawn, points, np.zeros((0, 3), np.int32), np.zeros(0, np.int64), points)

    def unit(self, xyz: np.ndarray) -> np.ndarray:
        """Source frame (n, 3) → unit frame, float64."""
        return self.drawn.to_unit(xyz)

    def hit(
        self, origin: list[float], direction: list[float], within: float = 0.0, extremity: bool = False
    ) -> Hit | None:
        """The first place that a ray (unit frame) meets, from either side of a face. Where it meets nothing, the place
        that looks nearest to it, at most `within` beside it for each unit that it is away; None where there is none.
        `extremity`: the tip beside that place."""
        start, along = np.asarray(origin, np.float64), np.asarray(direction, np.float64)
        along = along / np.linalg.norm(along)
        on_mesh = len(self.faces) > 0
        found = self._on_mesh(start, along, within) if on_mesh else self._on_cloud(start, along)
        if found is None or not extremity:
            return found
        used = np.unique(self.faces) if on_mesh else np.arange(len(self.vertices))
        tip = farthest_out(np.asarray(found.unit), self.unit(self.vertices[used]))
        if tip is None:
            return found
        if not on_mesh:
            return self._found(self.vertices[used[tip]], -along, along, None, {"point_index": int(used[tip])})
        faces, corners = np.nonzero(self.faces == used[tip])
        return self._at(int(faces[0]), np.eye(3)[corners[0]], along)

    def _on_mesh(self, start: np.ndarray, along: np.ndarray, within: float) -> Hit | None:
        """Möller and Trumbore, Fast minimum storage ray/triangle intersection (1997), on all faces at once."""
        corners = self.unit(self.vertices[self.faces])  # (f, 3, 3)
        ab, ac, from_a = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], start - corners[:, 0]
        p, q = np.cross(along, ac), np.cross(from_a, ab)
        determinant = np.einsum("fx,fx->f", ab, p)
        with np.errstate(divide="ignore", invalid="ignore"):
            v = np.einsum("fx,fx->f", from_a, p) / determinant
            w = q @ along / determinant
            far = np.einsum("fx,fx->f", ac, q) / determinant
            met = (
                (v >= -1e-9) & (w >= -1e-9) & (v + w <= 1 + 1e-9) & (far > 0)
            )  # a ray along an edge does not slip through
        if not met.any():
            near = nearest_to_ray(start, along, corners, within) if within > 0 else None
            return None if near is None else self._at(*near, along)
        face = int(np.where(met, far, np.inf).argmin())
        barycentrics = np.clip([1 - v[face] - w[face], v[face], w[face]], 0, 1)
        return self._at(face, barycentrics / barycentrics.sum(), along)

    def _at(self, face: int, barycentrics: np.ndarray, along: np.ndarray) -> Hit:
        corners = self.vertices[self.faces[face]]
        xyz, a_b_c = barycentrics @ corners, self.unit(corners)
        normal = np.cross(a_b_c[1] - a_b_c[0], a_b_c[2] - a_b_c[0])
        where = {"face_index": int(self.file_faces[face]), "face_uv": barycentrics.tolist()}
        return self._found(xyz, normal, along, where, self._nearest_point(xyz))

    def _on_cloud(self, start: np.ndarray, along: np.ndarray) -> Hit | None:
        points = self.unit(self.vertices)
        far = (points - start) @ along
        beside = np.linalg.norm(points - start - far[:, None] * along, axis=1)
        beside[far <= 0] = np.inf
        least = beside.min()
        if least > MISSED:
            return None
        first = int(np.where(beside <= max(BESIDE, least), far, np.inf).argmin())
        return self._found(self.vertices[first], -along, along, None, {"point_index": first})

    def _found(
        self,
        xyz: np.ndarray,
        normal: np.ndarray,
        along: np.ndarray,
        mesh: dict[str, Any] | None,
        cloud: dict[str, int] | None,
    ) -> Hit:
        normal = normal / np.linalg.norm(normal) * (-1 if normal @ along > 0 else 1)
        return Hit(xyz.tolist(), self.unit(xyz).tolist(), normal.tolist(), mesh, cloud)

    def _nearest_point(self, xyz: np.ndarray) -> dict[str, int] | None:
        if self.cloud is None:
            return None
        distance = np.linalg.norm(self.unit(self.cloud) - self.unit(xyz), axis=1)
        nearest = int(distance.argmin())
        return {"point_index": nearest} if distance[nearest] <= MISSED else None

    def drawing(self) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Vertices (v, 3) float32 in the unit frame, faces (f, 3) int32 (none for a cloud), colours (v, 3) uint8 or
        None."""
        surface = surface_of(self.drawn, DRAWN)
        if surface is None:
            return self.drawn.vertices, self.drawn.faces, self.drawn.vertex_colors
        return surface.vertices, surface.faces, self._colors(surface.vertices)

    def _colors(self, places: np.ndarray) -> np.ndarray | None:
        shape = self.drawn
        if shape.vertex_colors is None and shape.texture is None:
            return None
        on, _ = nearest_on_faces(places, shape.vertices, shape.faces)
        if shape.vertex_colors is not None:
            corners = shape.vertex_colors[shape.faces[on.faces]].astype(np.float64)
            return np.einsum("nc,ncx->nx", on.barycentrics, corners).round().astype(np.uint8)
        assert shape.texture is not None and shape.face_uvs is not None
        uv = np.einsum("nc,ncx->nx", on.barycentrics, shape.face_uvs[on.faces].astype(np.float64))
        height, width = shape.texture.shape[:2]
        column = np.clip(uv[:, 0] * width, 0, width - 1).astype(np.int64)
        row = np.clip((1 - uv[:, 1]) * height, 0, height - 1).astype(np.int64)
        return np.asarray(shape.texture[row, column])
