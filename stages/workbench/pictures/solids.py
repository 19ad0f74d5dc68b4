"""Shapes and keypoints as files that MeshLab and Blender open: PLY written here, for its scalars; GLB by trimesh."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from b23d.pipeline.inspection.artifact import MARK

RADIUS = 0.012  # of a predicted keypoint, unit frame; annotated ones are smaller, so that both are seen where they meet
TRUE_RADIUS = 0.008
TYPES = {"u1": "uchar", "<f4": "float", "<f8": "double"}
POINT = 0.0025  # half the width of a candidate that has to be a solid


@dataclass
class SceneObject:
    """Vertices with colours and scalars, and faces if it is a surface."""

    name: str
    vertices: np.ndarray
    """(v, 3) float32; float64 where the coordinates need it."""
    colors: np.ndarray
    """(v, 3) uint8."""
    faces: np.ndarray = field(default_factory=lambda: np.zeros((0, 3), np.int32))
    scalars: dict[str, np.ndarray] = field(default_factory=dict)
    """Name → (v,) float32."""
    uvs: np.ndarray | None = None
    """(v, 2), with `texture` (h, w, 3) uint8; GLB and OBJ only."""
    texture: np.ndarray | None = None


def sphere(name: str, center: np.ndarray, radius: float, color: tuple[int, int, int]) -> SceneObject:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    vertices = (ball.vertices + center).astype(np.float32)
    return SceneObject(
        name, vertices, np.tile(np.array(color, np.uint8), (len(vertices), 1)), ball.faces.astype(np.int32)
    )


def octahedra(name: str, points: np.ndarray, colors: np.ndarray) -> SceneObject:
    """Points (n, 3) as tiny solids, so that they are seen beside surfaces: many programs hide bare points there."""
    corners = POINT * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    sides = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
    faces = sides + 6 * np.arange(len(points))[:, None, None]
    vertices = (points[:, None] + corners).reshape(-1, 3).astype(np.float32)
    return SceneObject(name, vertices, np.repeat(colors, 6, axis=0), faces.reshape(-1, 3).astype(np.int32))


def merged(parts: list[SceneObject]) -> SceneObject:
    """All in one, with the scalar `part`: each vertex's place in the list."""
    starts = np.cumsum([0, *(len(part.vertices) for part in parts[:-1])])
    return SceneObject(
        "all",
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.colors for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]).astype(np.int32),
        {"part": np.repeat(np.arange(len(parts), dtype=np.float32), [len(part.vertices) for part in parts])},
    )


def write_ply(part: SceneObject, path: Path, comments: list[str]) -> None:
    """Binary PLY. The first scalar is written as `quality`, too: the name under which MeshLab shows one."""
    scalars = dict(part.scalars)
    if scalars:
        scalars = {"quality": next(iter(scalars.values())), **scalars}
    place = "<f8" if part.vertices.dtype == np.float64 else "<f4"
    columns: list[Any] = [(axis, place) for axis in "xyz"] + [(color, "u1") for color in ("red", "green", "blue")]
    table = np.zeros(len(part.vertices), np.dtype(columns + [(name, "<f4") for name in scalars]))
    for i, axis in enumerate("xyz"):
        table[axis] = part.vertices[:, i]
    for i, color in enumerate(("red", "green", "blue")):
        table[color] = part.colors[:, i]
    for name, values in scalars.items():
        table[name] = values
    header = [
        "ply",
        "format binary_little_endian 1.0",
        *(f"comment {line}" for line in [MARK, *comments]),
        f"element vertex {len(table)}",
    ]
    header += [f"property {TYPES[kind]} {name}" for name, kind in columns]
    header += [f"property float {name}" for name in scalars]
    faces = np.zeros(len(part.faces), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    faces["count"], faces["corners"] = 3, part.faces
    if len(faces):
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    path.write_bytes(
        "\n".join([*header, "end_header", ""]).encode("ascii", "replace") + table.tobytes() + faces.tobytes()
    )


def write_glb(parts: list[SceneObject], path: Path) -> None:
    """One named node a part; surfaces as meshes, the rest as points."""
    import trimesh

    scene = trimesh.Scene(metadata={"made_by": MARK})
    for part in parts:
        scene.add_geometry(_geometry(part), node_name=part.name, geom_name=part.name)
    path.write_bytes(scene.export(file_type="glb"))


def _geometry(part: SceneObject) -> Any:
    import trimesh

    rgba = np.concatenate([part.colors, np.full((len(part.colors), 1), 255, np.uint8)], axis=1)
    if not len(part.faces):
        return trimesh.PointCloud(part.vertices, colors=rgba)
    if part.uvs is None or part.texture is None:
        return trimesh.Trimesh(part.vertices, part.faces, vertex_colors=rgba, process=False)
    from PIL import Image
    from trimesh.visual.material import PBRMaterial
    from trimesh.visual.texture import TextureVisuals

    material = PBRMaterial(
        baseColorTexture=Image.fromarray(part.texture), metallicFactor=0.0, roughnessFactor=1.0, doubleSided=True
    )
    return trimesh.Trimesh(
        part.vertices, part.faces, visual=TextureVisuals(uv=part.uvs, material=material), process=False
    )
