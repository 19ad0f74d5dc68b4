"""Files of a folder, found with as few system calls as listing 8,000 shapes in a second needs."""

from __future__ import annotations

import os
import posixpath
from pathlib import Path

from stages.geometry.companions import gltf_files, material_files, ply_textures, texture_files

IMAGES = {".jpg", ".jpeg", ".png", ".bmp", ".tga", ".tif", ".tiff", ".webp", ".gif"}
HEAD = 1 << 16
"""Bytes at the start of an OBJ or PLY in which the files that it names are looked for."""


def walk(root: Path) -> dict[str, str]:
    """All files below `root`, sorted: path → place below the root with `/`. Hidden ones are passed over, links followed once."""
    files: dict[str, str] = {}
    folders = [(str(root), "")]
    linked: set[str] = set()
    while folders:
        folder, place = folders.pop()
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.name.startswith("."):
                    continue
                if not entry.is_dir():
                    files[entry.path] = place + entry.name
                    continue
                target = os.path.realpath(entry.path) if entry.is_symlink() else None
                if target is None or target not in linked:
                    folders.append((entry.path, f"{place}{entry.name}/"))
                    linked.update([target] if target else [])
    return dict(sorted(files.items()))


class Listing:
    """Names in folders, each folder read once; case does not matter."""

    def __init__(self) -> None:
        self._folders: dict[str, dict[str, str]] = {}

    def find(self, folder: Path, name: str) -> Path | None:
        """The file `folder/name`, or None where there is none."""
        place = posixpath.normpath(posixpath.join(folder.as_posix(), name))
        parent, base = posixpath.split(place)
        if parent not in self._folders:
            try:
                with os.scandir(parent) as entries:
                    names = sorted(entry.name for entry in entries)
                self._folders[parent] = {other.lower(): other for other in names}
            except OSError:
                self._folders[parent] = {}
        found = self._folders[parent].get(base.lower())
        return None if found is None else Path(parent, found)


def companions(mesh: Path, suffixes: set[str], listing: Listing) -> dict[str, Path]:
    """The files a mesh names, by name relative to it; those that are absent are left out (normalize counts them).

    `suffixes`: of all files there are, so that no mesh is opened in vain.
    """
    suffix = mesh.suffix.lower()
    found: dict[str, Path] = {}

    def add(names: list[str]) -> None:
        found.update({name: path for name in names if (path := listing.find(mesh.parent, name)) is not None})

    if suffix == ".obj" and ".mtl" in suffixes:
        add(material_files(_head(mesh)))
        for name, path in list(found.items()):
            add(texture_files(path.read_bytes(), name))
    elif suffix == ".ply" and suffixes & IMAGES:
        add(ply_textures(_head(mesh)))
    elif suffix == ".gltf":
        add(gltf_files(mesh.read_bytes()))
    return found


def has_faces(ply: str) -> bool:
    """Whether a PLY's header announces faces."""
    words = [line.split() for line in _head(Path(ply)).split(b"end_header")[0].splitlines()]
    return any(line[:2] == [b"element", b"face"] and line[2:] not in ([], [b"0"]) for line in words)


def _head(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(HEAD)
