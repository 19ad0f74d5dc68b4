"""A shape's files (bytes) → Surface or Cloud in the source frame. Every failure is a ValueError that names the
shape."""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Mapping

from b23d.stages.geometry.surface import Cloud, MalformedError, Surface

MESH_SUFFIXES = (".ply", ".obj", ".off", ".stl", ".glb", ".gltf")
CLOUD_SUFFIXES = (".pcd", ".xyz", ".npz")
"""PLY is read as either; its content tells."""


def load(
    shape: str, files: dict[str, bytes], name: str, colors: bool = True, own_names: Mapping[str, str] | None = None
) -> Surface | Cloud:
    """Read the file `name` of a shape; `files` holds it and what it refers to. `own_names`: what messages call files.

    A mesh format without any face gives a Cloud. Coordinates may still hold NaN; face indices are within the vertices.
    Raises ValueError (empty, unreadable, neither faces nor points, face index out of range) with the shape's name.
    """
    data = files.get(name)
    suffix = posixpath.splitext(name)[1].lower()
    reader = _reader(suffix)
    called = (own_names or {}).get(name, name)
    if data is None:
        raise ValueError(f"{shape}: expected {called} among its files, got {sorted(files)}; add the file")
    if reader is None:
        formats = " ".join((*MESH_SUFFIXES, *CLOUD_SUFFIXES))
        raise ValueError(f"{shape}: expected one of {formats}, got {called}; convert the file")
    if not data.strip():
        raise ValueError(f"{shape}: expected geometry in {called}, got an empty file; restore it or remove the shape")
    try:
        loaded = reader(data, files, colors)
    except MalformedError as error:
        raise ValueError(f"{shape}: {called}: {error}") from error
    except Exception as error:  # on bytes nobody foresaw: whatever it is, the file is at fault
        raise ValueError(
            f"{shape}: {called}: expected a readable {suffix[1:]} file, got one this reader does not understand "
            f"({type(error).__name__}: {str(error)[:200]}); open it in another program and export it again"
        ) from error
    if isinstance(loaded, Cloud) and not len(loaded.points):
        raise ValueError(f"{shape}: expected faces or points in {called}, got neither; restore it or remove the shape")
    return loaded


Reader = Callable[[bytes, dict[str, bytes], bool], Surface | Cloud]


def _reader(suffix: str) -> Reader | None:
    from b23d.stages.geometry import clouds, gltf, obj, off, pcd, ply, stl

    readers: dict[str, Reader] = {
        ".obj": obj.read_obj,
        ".ply": ply.read_ply,
        ".off": lambda data, files, colors: off.read_off(data, colors),
        ".stl": lambda data, files, colors: stl.read_stl(data),
        ".glb": gltf.read_gltf,
        ".gltf": gltf.read_gltf,
        ".pcd": lambda data, files, colors: pcd.read_pcd(data),
        ".xyz": lambda data, files, colors: clouds.read_xyz(data),
        ".npz": lambda data, files, colors: clouds.read_npz(data),
    }
    return readers.get(suffix)
