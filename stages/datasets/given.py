"""Shapes handed over in Python: no folder, no run file. A shape is its content: equal arrays have one address."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import PrivateAttr

from b23d.pipeline.dataset import Dataset, Leaf, Shape, dataset
from b23d.schemas.shape import Source
from b23d.schemas.wording import counted
from b23d.stages.datasets.files import Companions
from b23d.stages.datasets.sources import source_leaf
from b23d.stages.geometry.loading import CLOUD_SUFFIXES, MESH_SUFFIXES

CATEGORY = "given"


@dataset("given")
class GivenShapes(Dataset):
    """The shapes of `b23d.features` and `b23d.match`."""

    handed_over: ClassVar[bool] = True

    kind: Literal["given"] = "given"

    _shapes: list[Shape] = PrivateAttr(default_factory=list)

    @classmethod
    def of(cls, **things: Any) -> GivenShapes:
        """A data set of one shape a name. Each is a path, an object with `.vertices` and `.faces` (trimesh) or
        `.triangles` (open3d), one with `.points`, `(vertices, faces)` arrays, or an (n, 3) array of points.

        Raises FileNotFoundError, ValueError or TypeError with the name, where it is none of them.
        """
        given = cls()
        given._shapes = [Shape(name, CATEGORY, {"source": _leaf(name, thing)}) for name, thing in things.items()]
        return given

    def shapes(self) -> list[Shape]:
        """Those that were handed over."""
        return self._shapes


def _leaf(name: str, thing: Any) -> Leaf:
    if isinstance(thing, str | Path):
        return _file(name, Path(thing))
    vertices, faces, colors = arrays_of(thing, name)
    data = ply_bytes(vertices, faces, colors)
    role = "mesh" if len(faces) else "cloud"
    values = {"role": role, "data": base64.b64encode(data).decode()}
    return Leaf(load_given, values, context={"shape": f"{CATEGORY}/{name}"})


def _file(name: str, path: Path) -> Leaf:
    """As the folder data set reads it: the same file has the same address in both."""
    path = path.expanduser().resolve()
    if not path.is_file():
        what = "a folder" if path.is_dir() else "no file at"
        raise FileNotFoundError(f"{name}: expected a mesh or cloud, got {what} {path}; give the path of one")
    suffix = path.suffix.lower()
    if suffix not in MESH_SUFFIXES + CLOUD_SUFFIXES:
        formats = " ".join((*MESH_SUFFIXES, *CLOUD_SUFFIXES))
        raise ValueError(f"{name}: expected a file of {formats}, got {path.name}; convert it")
    mesh = None if suffix in CLOUD_SUFFIXES else str(path)
    beside = Companions(str(other) for other in path.parent.iterdir()).of(mesh) if mesh else {}
    cloud = str(path) if mesh is None else None
    return source_leaf(f"{CATEGORY}/{name}", mesh, cloud, beside)


def load_given(files: dict[str, bytes], values: dict[str, Any]) -> Source:
    """A Source of the arrays, as a PLY."""
    name = f"{values['role']}.ply"
    source = {name: base64.b64decode(values["data"])}
    if values["role"] == "mesh":
        return Source(shape=values.get("shape", "the shape"), files=source, mesh=name)
    return Source(shape=values.get("shape", "the shape"), files=source, cloud=name)


def arrays_of(thing: Any, name: str = "the shape") -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Vertices (v, 3) float64, faces (f, 3) int32 (none for a cloud) and colours (v, 3) uint8 or None, of what
    `GivenShapes.of` takes."""
    faces: Any = None
    if isinstance(thing, tuple | list) and len(thing) == 2:
        vertices, faces = thing
    elif hasattr(thing, "vertices"):
        vertices, faces = thing.vertices, getattr(thing, "faces", getattr(thing, "triangles", None))
    else:
        vertices = getattr(thing, "points", thing)
    try:
        vertices = np.asarray(vertices, np.float64)
        faces = np.zeros((0, 3), np.int32) if faces is None else np.asarray(faces)
    except (TypeError, ValueError) as error:
        raise TypeError(f"{name}: expected a path, a mesh or arrays, got {type(thing).__name__}; {TAKES}") from error
    if vertices.ndim != 2 or vertices.shape[1:] != (3,):
        raise ValueError(f"{name}: expected vertices (v, 3), got an array of shape {vertices.shape}; {TAKES}")
    if faces.size and (faces.ndim != 2 or faces.shape[1] != 3 or faces.dtype.kind not in "iu"):
        raise ValueError(f"{name}: expected integer faces (f, 3), got {faces.dtype} {faces.shape}; {TAKES}")
    if faces.size and not (faces.min() >= 0 and faces.max() < len(vertices)):
        wrong = faces[(faces < 0) | (faces >= len(vertices))][0]
        many = counted(len(vertices), "vertex", "vertices")
        raise ValueError(f"{name}: expected faces of its {many}, counted from 0, got index {wrong}; mend them")
    return vertices, faces.reshape(-1, 3).astype(np.int32), _colors(thing, len(vertices))


TAKES = "it takes a path, an object with .vertices and .faces or .triangles, (vertices, faces), or points (n, 3)"


def _colors(thing: Any, count: int) -> np.ndarray | None:
    """(v, 3) uint8 of a trimesh object (its texture read at the vertices) or an open3d one; None: it has none."""
    visual = getattr(thing, "visual", None)
    if visual is not None and getattr(visual, "defined", False):
        plain = visual.to_color() if hasattr(visual, "to_color") else visual
        colors = np.asarray(plain.vertex_colors)
    else:
        colors = np.asarray(getattr(thing, "vertex_colors", getattr(thing, "colors", [])))
    if colors.ndim != 2 or len(colors) != count or colors.shape[1] < 3:
        return None
    colors = colors[:, :3]
    return colors.astype(np.uint8) if colors.dtype.kind in "iu" else np.rint(colors.clip(0, 1) * 255).astype(np.uint8)


def ply_bytes(vertices: np.ndarray, faces: np.ndarray, colors: np.ndarray | None) -> bytes:
    """A binary PLY that keeps every bit: float64 coordinates."""
    kinds: list[Any] = [("at", "<f8", 3)] + ([("color", "u1", 3)] if colors is not None else [])
    table = np.zeros(len(vertices), np.dtype(kinds))
    table["at"] = vertices
    if colors is not None:
        table["color"] = colors
    polygons = np.zeros(len(faces), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    polygons["count"], polygons["corners"] = 3, faces
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property double {axis}" for axis in "xyz"]
    header += [f"property uchar {color}" for color in ("red", "green", "blue") if colors is not None]
    if len(faces):
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    return "\n".join([*header, "end_header", ""]).encode() + table.tobytes() + polygons.tobytes()
