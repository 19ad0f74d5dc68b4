"""Shading, the same for every renderer: a grey or coloured Lambertian surface, lit from the camera, on white.

Light: one point light at the camera ("one light source at the camera position for each rendering view", Back to 3D,
Sec. 4.1) without fall-off. Both sides of a face are lit alike, `|n·l|`, since orientation is inconsistent in real data.
Values are written as they are: 8-bit level = 255 × albedo × (ambient + (1 - ambient) |n·l|), with no gamma curve, so
that grey .7 facing the camera is 178 (an sRGB viewer shows it as that level).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.stages.geometry.cameras import pixel_rays
from b23d.stages.renderers import Raster
from b23d.stages.renderers.texture import Texture, texels_per_pixel

BACKGROUND = 255


@dataclass(frozen=True)
class ShadedSurface:
    """What is drawn. Without corner normals faces are flat; without colours and texture they have the albedo asked
    for."""

    vertices: np.ndarray
    """(v, 3) float32, unit frame"""
    faces: np.ndarray
    """(f, 3) int32"""
    corner_normals: np.ndarray | None = None
    """(f, 3, 3) float32: for each face the unit normals at its corners, on one side of it."""
    corner_colors: np.ndarray | None = None
    """(f, 3, 3) float32 in [0, 1]"""
    corner_uvs: np.ndarray | None = None
    """(f, 3, 2) float32, origin at the texture's lower left"""
    texture: np.ndarray | None = None
    """(h, w, 3) uint8"""

    @property
    def plain(self) -> bool:
        """Whether a pixel's place within its face does not matter."""
        return self.corner_normals is None and self.corner_colors is None and self.texture is None


def face_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(f, 3) float64, length twice the face's area."""
    a, b, c = np.moveaxis(np.asarray(vertices, np.float64)[faces], 1, 0)
    return np.cross(b - a, c - a)


def smooth_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(f, 3, 3) float32 corner normals: area-weighted means over the faces at a vertex, turned to the face's own
    side."""
    flat = face_normals(vertices, faces)
    sums = np.stack(
        [np.bincount(faces.ravel(), np.repeat(flat[:, axis], 3), len(vertices)) for axis in range(3)], axis=1
    )
    corners = _unit(sums)[faces]
    side = np.where(np.einsum("fci,fi->fc", corners, flat) < 0, -1, 1)
    cancelled = (corners == 0).all(axis=2, keepdims=True)  # faces of opposite orientation, back to back
    return np.where(cancelled, _unit(flat)[:, None], corners * side[..., None]).astype(np.float32)


def shade(
    surface: ShadedSurface,
    raster: Raster,
    world_to_camera: np.ndarray,
    intrinsics: np.ndarray,
    albedo: float,
    ambient: float,
) -> np.ndarray:
    """Pictures (view, row, column, 3) uint8 of what `raster` says every pixel sees."""
    resolution = raster.face_ids.shape[1]
    rays = pixel_rays(intrinsics, resolution).reshape(-1, 3).astype(np.float32)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    triangles = surface.vertices[surface.faces]
    flat = _unit(face_normals(surface.vertices, surface.faces)).astype(np.float32)
    texture = None if surface.texture is None else Texture(surface.texture)
    images = np.full((len(world_to_camera), resolution**2, 3), BACKGROUND, np.uint8)
    for view, transform in enumerate(world_to_camera.astype(np.float32)):
        hit = np.flatnonzero(raster.face_ids[view] >= 0)
        ids = raster.face_ids[view].ravel().take(hit)
        ray = rays.take(hit, axis=0) @ transform[:3, :3]
        normals, color = flat.take(ids, axis=0), np.full((1, 1), albedo)
        if not surface.plain:
            corners = (
                triangles.take(ids, axis=0) + transform[:3, 3] @ transform[:3, :3]
            )  # from the camera, world's axes
            place = _barycentrics(ray, corners)
            if surface.corner_normals is not None:
                normals = _unit(_interpolate(place, surface.corner_normals.take(ids, axis=0)))
            if texture is not None and surface.corner_uvs is not None:
                uvs = surface.corner_uvs.take(ids, axis=0)
                scale = texels_per_pixel(corners @ transform[:3, :3].T, uvs, texture.size, intrinsics)
                color = texture.sample(_interpolate(place, uvs), scale)
            elif surface.corner_colors is not None:
                color = _interpolate(place, surface.corner_colors.take(ids, axis=0))
        cosine = np.minimum(np.abs(np.einsum("pi,pi->p", normals, ray)), 1)
        light = ambient + (1 - ambient) * cosine[:, None]
        images[view, hit] = np.rint(255 * np.minimum(color * light, 1)).astype(np.uint8)
    return images.reshape(*raster.face_ids.shape, 3)


def _barycentrics(rays: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(p, 3): where rays (p, 3) from the origin meet triangles (p, 3, 3). Each is ∝ the volume opposite to its
    corner."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    volumes = np.stack([np.einsum("pi,pi->p", rays, _cross(*pair)) for pair in ((b, c), (c, a), (a, b))], axis=1)
    total = volumes.sum(axis=1, keepdims=True)
    volumes = np.divide(volumes, total, out=np.full_like(volumes, 1 / 3), where=total != 0)
    inside = np.clip(volumes, 0, 1)  # at a face's edge renderers may be off by a rounding
    return inside / inside.sum(axis=1, keepdims=True)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """np.cross of (p, 3) and (p, 3), a third of its time."""
    return a[:, [1, 2, 0]] * b[:, [2, 0, 1]] - a[:, [2, 0, 1]] * b[:, [1, 2, 0]]


def _interpolate(place: np.ndarray, corner_values: np.ndarray) -> np.ndarray:
    return np.einsum("pc,pci->pi", place, corner_values)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors of unit length; zero stays zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
