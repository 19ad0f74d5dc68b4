"""glTF 2.0, text and binary: all meshes of a scene in one Surface, transforms applied; its points where it has none."""

from __future__ import annotations

from typing import Any

import numpy as np

from b23d.schemas.wording import counted
from b23d.stages.geometry.gltf_compression import draco_primitive
from b23d.stages.geometry.gltf_document import Document
from b23d.stages.geometry.gltf_materials import material, moved_uvs, texture_info, tinted, uv_set
from b23d.stages.geometry.gltf_nodes import Placed, placed_meshes
from b23d.stages.geometry.merging import merge
from b23d.stages.geometry.polygons import check_corners
from b23d.stages.geometry.strips import fan_triangles, strip_triangles
from b23d.stages.geometry.surface import Cloud, MalformedError, Surface, to_uint8

POINTS, TRIANGLES, STRIP, FAN = 0, 4, 5, 6
DRACO = "KHR_draco_mesh_compression"


def read_gltf(data: bytes, files: dict[str, bytes], colors: bool) -> Surface | Cloud:
    """All meshes of the default scene (else of the first, else of all nodes), in the order of the file's meshes.

    Sparse, normalized and compressed accessors, instances, default morphs and skins as bound are applied; mirroring
    transforms turn the winding, so that outward faces stay outward. Points and lines beside faces are counted in
    `problems`. Raises MalformedError, by name for what is not known here.
    """
    document = Document.of(data, files)
    parts: list[Surface] = []
    points: list[Surface] = []
    problems: dict[str, int] = {}
    for placed in placed_meshes(document):
        for primitive in document.entry("meshes", placed.mesh)["primitives"]:
            mode = primitive.get("mode", TRIANGLES)
            if mode in (POINTS, TRIANGLES, STRIP, FAN) and "POSITION" in primitive["attributes"]:
                (points if mode == POINTS else parts).extend(_placed(document, placed, primitive, mode, colors))
            else:
                problems["skipped_lines"] = problems.get("skipped_lines", 0) + 1
    parts = [part for part in parts if len(part.faces)]
    if parts:
        surface = parts[0] if len(parts) == 1 else merge(parts)
        for what, times in {**problems, "skipped_points": sum(len(part.vertices) for part in points)}.items():
            surface.count(what, times)
        return surface
    if not points:
        raise MalformedError("scene: expected a mesh or points, got neither; export the shape again")
    colored = [part.vertex_colors for part in points if part.vertex_colors is not None]
    every = np.concatenate([part.vertices for part in points])
    return Cloud(every, np.concatenate(colored) if len(colored) == len(points) else None, problems=problems)


def _placed(document: Document, placed: Placed, primitive: dict[str, Any], mode: int, colors: bool) -> list[Surface]:
    """A primitive wherever a node puts it."""
    index, attributes = _data(document, primitive)
    vertices = attributes["POSITION"]
    for weight, target in zip(_weights(document, placed), primitive.get("targets", []), strict=False):
        if weight and "POSITION" in target:
            vertices = vertices + weight * document.floats(target["POSITION"])
    corners = np.arange(len(vertices)) if index is None else index
    check_corners(corners, np.full(len(corners), 1), len(vertices), what="index")
    problems: dict[str, int] = {}
    shown = Surface(vertices, _triangles(corners, mode, problems), problems=problems)
    if mode == POINTS and index is not None:
        shown.vertices = vertices[corners]
        attributes = {name: values[corners] for name, values in attributes.items()}
    if colors:
        _appearance(document, shown, primitive, attributes)
    document.spend((len(placed.matrices) - 1) * (shown.vertices.size + shown.faces.size))
    if placed.joints is not None and "JOINTS_0" in attributes:
        shown.vertices = _bound(shown.vertices, attributes, placed.joints)
        return [shown]
    return [_moved(shown, matrix) for matrix in placed.matrices]


def _data(document: Document, primitive: dict[str, Any]) -> tuple[np.ndarray | None, dict[str, np.ndarray]]:
    """Corners (c,) int64 or None, and attributes (v, width): float64, colours as stored."""
    accessors: dict[str, int] = primitive["attributes"]
    corners, unpacked = None, {}
    packed = primitive.get("extensions", {}).get(DRACO)
    if packed is not None:
        corners, raw = draco_primitive(document.view(packed["bufferView"])[0], packed["attributes"])
        for name, values in raw.items():
            scaled = document.entry("accessors", accessors[name]).get("normalized", False) and values.dtype.kind in "iu"
            unpacked[name] = (
                values if name == "COLOR_0" else values / np.iinfo(values.dtype).max if scaled else values * 1.0
            )
    elif "indices" in primitive:
        corners = document.raw(primitive["indices"])[:, 0].astype(np.int64)
    wanted = ("POSITION", "COLOR_0", "TEXCOORD_", "JOINTS_", "WEIGHTS_")
    for name, accessor in accessors.items():
        if name.startswith(wanted) and name not in unpacked:
            unpacked[name] = document.raw(accessor) if name == "COLOR_0" else document.floats(accessor)
    count = len(unpacked["POSITION"])
    wrong = next((name for name, values in unpacked.items() if len(values) != count), None)
    if wrong is not None or unpacked["POSITION"].shape[1] != 3:
        raise MalformedError(
            f"{wrong or 'POSITION'}: expected 3 coordinates and as much of everything for "
            f"{counted(count, 'vertex', 'vertices')}, got {unpacked[wrong or 'POSITION'].shape}; export the shape again"
        )
    return corners, unpacked


def _weights(document: Document, placed: Placed) -> list[float]:
    """The morph weights of a mesh at rest."""
    weights = placed.node.get("weights", document.entry("meshes", placed.mesh).get("weights", []))
    return [float(weight) for weight in weights]


def _triangles(corners: np.ndarray, mode: int, problems: dict[str, int]) -> np.ndarray:
    if mode == POINTS:
        return np.zeros((0, 3), np.int64)
    if mode == STRIP:
        return strip_triangles(np.append(corners, -1))
    if mode == FAN:
        return fan_triangles(corners)
    if len(corners) % 3:
        problems["incomplete_triangles"] = 1
    return corners[: len(corners) // 3 * 3].reshape(-1, 3)


def _appearance(
    document: Document, surface: Surface, primitive: dict[str, Any], attributes: dict[str, np.ndarray]
) -> None:
    """Vertex colours times the base factor, or the material with its image."""
    texture = linear = None
    if "material" in primitive:
        texture, linear, _ = texture_info(document, primitive["material"])
        surface.materials = [material(document, primitive["material"], surface.problems)]
        surface.face_materials = np.zeros(len(surface.faces), np.int64)
    if "COLOR_0" in attributes and not any(m.image is not None for m in surface.materials):
        stored = attributes["COLOR_0"][:, :3]
        shades = to_uint8(np.clip(stored, 0, 1) * 255) if stored.dtype.kind == "f" else to_uint8(stored)
        surface.vertex_colors = tinted(shades, linear)
    elif texture is not None and (name := uv_set(texture)) in attributes:
        surface.face_uvs = moved_uvs(attributes[name][:, :2], texture)[surface.faces]
    elif texture is not None:
        surface.count("missing_texture_coordinates", 1)


def _bound(vertices: np.ndarray, attributes: dict[str, np.ndarray], joints: np.ndarray) -> np.ndarray:
    """Vertices (v, 3) of a skinned mesh in the world: each moved by the weighted mean of its joints' matrices."""
    moved, total = np.zeros_like(vertices), np.zeros((len(vertices), 1))
    homogeneous = np.concatenate([vertices, np.ones((len(vertices), 1))], axis=1)
    sets = [name[len("JOINTS_") :] for name in attributes if name.startswith("JOINTS_")]
    for number in sets:
        which, weights = attributes[f"JOINTS_{number}"].astype(np.int64), attributes[f"WEIGHTS_{number}"]
        if len(which) and (which.max() >= len(joints) or which.min() < 0):
            raise MalformedError(f"skin: expected joints below {len(joints)}, got {which.max()}; export it again")
        for i in range(which.shape[1]):
            moved += weights[:, i : i + 1] * np.einsum("vab,vb->va", joints[which[:, i], :3], homogeneous)
            total += weights[:, i : i + 1]
    return moved / np.where(total > 0, total, 1)


def _moved(surface: Surface, matrix: np.ndarray) -> Surface:
    """The surface in the world."""
    moved = Surface(
        surface.vertices @ matrix[:3, :3].T + matrix[:3, 3],
        surface.faces,
        surface.vertex_colors,
        surface.materials,
        surface.face_materials,
        surface.face_uvs,
        surface.problems,
    )
    if np.linalg.det(matrix[:3, :3]) < 0:
        moved.faces = surface.faces[:, ::-1]
        moved.face_uvs = None if surface.face_uvs is None else surface.face_uvs[:, ::-1]
    return moved
