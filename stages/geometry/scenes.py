"""STL, GLB and glTF through trimesh: all nodes of a scene in one Surface, transforms applied."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import trimesh
from trimesh.resolvers import Resolver

from b23d.stages.geometry.images import find, flatten
from b23d.stages.geometry.surface import (
    GREY,
    Cloud,
    MalformedError,
    Material,
    Surface,
    check_faces,
    to_uint8,
    unique_colors,
)


class Files(Resolver):
    """Gives trimesh the files of a shape by the names that they call each other."""

    def __init__(self, files: dict[str, bytes]) -> None:
        self.files = files

    def get(self, name: str) -> bytes:
        data = find(self.files, name)
        if data is None:
            raise FileNotFoundError(f"{name}: expected it among the shape's files, got {sorted(self.files)}; add it")
        return data

    def keys(self) -> list[str]:
        return list(self.files)

    def namespaced(self, namespace: str) -> Files:
        return self

    def write(self, name: str, data: Any) -> None:
        raise NotImplementedError("a shape's files are only read")


def read_scene(data: bytes, kind: str, files: dict[str, bytes], colors: bool) -> Surface | Cloud:
    """All meshes of a scene, in the order of the file's geometries; its points, where it has no mesh. Raises
    MalformedError.

    Mirroring transforms turn the winding, so that outward faces stay outward.
    """
    scene = trimesh.load_scene(io.BytesIO(data), file_type=kind, resolver=Files(files), process=False)
    order = {name: i for i, name in enumerate(scene.geometry)}
    nodes = sorted(scene.graph.nodes_geometry, key=lambda node: (order.get(scene.graph[node][1], -1), str(node)))
    parts = [(scene.geometry[scene.graph[node][1]], np.asarray(scene.graph[node][0], np.float64)) for node in nodes]
    meshes = [
        _part(mesh, matrix, colors) for mesh, matrix in parts if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)
    ]
    if meshes:
        return meshes[0] if len(meshes) == 1 else merge(meshes)
    clouds = [
        (_moved(g.vertices, matrix), _cloud_colors(g) if colors else None)
        for g, matrix in parts
        if hasattr(g, "vertices")
    ]
    if not clouds:
        raise MalformedError("scene: expected a mesh or points, got neither; export the shape again")
    points = np.concatenate([points for points, _ in clouds])
    colored = [c for _, c in clouds if c is not None]
    return Cloud(points, np.concatenate(colored) if len(colored) == len(clouds) else None)


def merge(parts: list[Surface]) -> Surface:
    """One surface of several, one after another."""
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts])
    whole = Surface(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + offset for part, offset in zip(parts, offsets[:-1], strict=True)]),
    )
    whole.materials = [material for part in parts for material in part.materials]
    firsts = np.cumsum([0] + [len(part.materials) for part in parts])
    if whole.materials:
        none = [np.full(len(part.faces), -1) if part.face_materials is None else part.face_materials for part in parts]
        whole.face_materials = np.concatenate(
            [np.where(m < 0, -1, m + first) for m, first in zip(none, firsts[:-1], strict=True)]
        )
    if any(part.face_uvs is not None for part in parts):
        absent = [
            np.full((len(part.faces), 3, 2), np.nan) if part.face_uvs is None else part.face_uvs for part in parts
        ]
        whole.face_uvs = np.concatenate(absent)
    if any(part.vertex_colors is not None for part in parts):
        whole.vertex_colors = np.concatenate([_vertex_colors(part) for part in parts])
    return whole


def _part(mesh: Any, matrix: np.ndarray, colors: bool) -> Surface:
    faces = np.asarray(mesh.faces, np.int64)
    vertices = np.asarray(mesh.vertices, np.float64)
    check_faces(faces, len(vertices))
    surface = Surface(_moved(vertices, matrix), faces)
    if colors:
        _appearance(surface, mesh.visual)
    if np.linalg.det(matrix[:3, :3]) < 0:
        surface.faces = faces[:, ::-1]
        surface.face_uvs = None if surface.face_uvs is None else surface.face_uvs[:, ::-1]
    return surface


def _appearance(surface: Surface, visual: Any) -> None:
    """Vertex colours, face colours or a material, as trimesh's visual has them."""
    if visual.kind == "vertex" and len(visual.vertex_colors) == len(surface.vertices):
        surface.vertex_colors = to_uint8(np.asarray(visual.vertex_colors)[:, :3])
    elif visual.kind == "face" and len(visual.face_colors) == len(surface.faces):
        palette, which = unique_colors(to_uint8(np.asarray(visual.face_colors)[:, :3]))
        surface.materials = [Material(color=(int(r), int(g), int(b))) for r, g, b in palette]
        surface.face_materials = which
    elif visual.kind == "texture":
        surface.materials = [_material(visual.material)]
        surface.face_materials = np.zeros(len(surface.faces), np.int64)
        uv = visual.uv
        if uv is not None and len(uv) == len(surface.vertices):
            surface.face_uvs = np.asarray(uv, np.float64)[surface.faces, :2]


def _material(material: Any) -> Material:
    """glTF's metallic-roughness material: base colour times base texture. The factor is linear light, the texture
    sRGB."""
    factor = getattr(material, "baseColorFactor", None)
    image = getattr(material, "baseColorTexture", None)
    opaque = getattr(material, "alphaMode", None) in (None, "OPAQUE")
    linear = (
        None
        if factor is None
        else np.asarray(factor, np.float64)[:3] / (255 if np.asarray(factor).dtype == np.uint8 else 1)
    )
    if image is not None:
        pixels = flatten(image, opaque)
        if linear is not None and (linear < 1).any():
            pixels = to_uint8(_srgb(_linear(pixels / 255.0) * linear) * 255)
        return Material(image=pixels)
    if linear is None:
        return Material()
    red, green, blue = (int(c) for c in np.rint(_srgb(linear) * 255))
    return Material(color=(red, green, blue))


def _srgb(linear: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1, values in [0, 1]."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def _linear(srgb: np.ndarray) -> np.ndarray:
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def _moved(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    return np.asarray(points, np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def _cloud_colors(cloud: Any) -> np.ndarray | None:
    colors = getattr(cloud, "colors", None)
    return None if colors is None or len(colors) != len(cloud.vertices) else to_uint8(np.asarray(colors)[:, :3])


def _vertex_colors(part: Surface) -> np.ndarray:
    """A part's vertex colours; where it has none, those of its materials (its vertices are its own)."""
    if part.vertex_colors is not None:
        return part.vertex_colors
    colors = np.tile(np.array(GREY, np.uint8), (len(part.vertices), 1))
    if part.face_materials is not None:
        palette = np.array([m.color or GREY for m in part.materials] + [GREY], np.uint8)
        colors[part.faces] = palette[part.face_materials][:, None]
    return colors
