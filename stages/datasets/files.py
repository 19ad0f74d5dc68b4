"""The files that meshes name, found with as few system calls as listing 8,000 shapes in a second needs."""

from __future__ import annotations

import gc
import mmap
import os
import posixpath
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from b23d.stages.datasets.walking import encodable
from b23d.stages.geometry.companions import gltf_files, material_files, ply_textures, texture_files
from b23d.stages.geometry.encoding import alike, unmarked

IMAGES = {".jpg", ".jpeg", ".png", ".bmp", ".tga", ".tif", ".tiff", ".webp", ".gif"}
HEAD = 1 << 16
"""Bytes at the start of a PLY in which the files that it names are looked for; longer OBJs are searched in place."""
HEAD_OF_TEXT = 64
"""Bytes among which a zero tells UTF-16."""


@contextmanager
def uncollected() -> Iterator[None]:
    """Without the cyclic garbage collector: listing makes a million small objects and no cycle, and collecting over and
    over takes longer than all the rest."""
    collects = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if collects:
            gc.enable()


class Companions:
    """The files that meshes name. Every folder and every material file is read once, and no mesh in vain."""

    def __init__(self, paths: Iterable[str]) -> None:
        """`paths`: all files there are, to know whether opening a mesh can be worth it."""
        self._suffixes = {posixpath.splitext(path)[1].lower() for path in paths}
        self._folders: dict[str, dict[str, str]] = {}
        self._textures: dict[tuple[str, str], list[str]] = {}

    def of(self, mesh: str) -> dict[str, Path]:
        """The regular files a mesh names, by name relative to it; those that are absent are left out (normalize counts
        them). Raises OSError where one cannot be read, ValueError or RecursionError where it cannot be understood."""
        folder, suffix = posixpath.dirname(mesh), posixpath.splitext(mesh)[1].lower()
        if suffix == ".obj" and ".mtl" in self._suffixes:
            materials = self._existing(folder, material_files(_material_lines(mesh)))
            names = [texture for name, path in materials.items() for texture in self._textures_of(path, name)]
            return {name: Path(path) for name, path in {**materials, **self._existing(folder, names)}.items()}
        if suffix == ".ply" and self._suffixes & IMAGES:
            return {name: Path(path) for name, path in self._existing(folder, ply_textures(_head(mesh))).items()}
        if suffix in (".gltf", ".glb"):
            return {name: Path(path) for name, path in self._existing(folder, gltf_files(_gltf(mesh))).items()}
        return {}

    def _existing(self, folder: str, names: list[str]) -> dict[str, str]:
        return {name: path for name in names if (path := self._find(folder, name)) is not None}

    def _find(self, folder: str, name: str) -> str | None:
        """The path of `folder/name`, in any case; None where there is none."""
        parent, base = posixpath.split(posixpath.normpath(f"{folder}/{name}"))
        if parent not in self._folders:
            try:
                with os.scandir(parent) as entries:
                    files = sorted(entry.name for entry in entries if entry.is_file() and encodable(entry.name))
                self._folders[parent] = {alike(name): name for name in files}
            except OSError:
                self._folders[parent] = {}
        found = self._folders[parent].get(alike(base))
        return None if found is None else f"{parent}/{found}"

    def _textures_of(self, path: str, name: str) -> list[str]:
        if (path, name) not in self._textures:
            self._textures[path, name] = texture_files(Path(path).read_bytes(), name)
        return self._textures[path, name]


def has_faces(ply: str) -> bool:
    """Whether a PLY's header announces faces or strips: an element with lists, beside the vertices."""
    element: list[bytes] = []
    lists = False
    for words in (line.split() for line in unmarked(_head(ply)).split(b"end_header")[0].splitlines()):
        if words[:1] == [b"element"]:
            element = words[1:]
        elif words[:2] == [b"property", b"list"] and element[:1] not in ([b"vertex"], [b"range_grid"]):
            lists = lists or element[1:] not in ([], [b"0"])
    return lists


def _material_lines(obj: str) -> bytes:
    """The `mtllib` lines of an OBJ, wherever they stand: programs that join files leave them in the middle."""
    with Path(obj).open("rb") as file:
        head = file.read(HEAD)
        if len(head) < HEAD or b"\0" in head[:HEAD_OF_TEXT]:
            return head + file.read()
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as whole:
            return b"\n".join(line for keyword in (b"mtllib", b"MTLLIB") for line in _lines_of(whole, keyword))


def _lines_of(text: mmap.mmap, keyword: bytes) -> Iterator[bytes]:
    """The lines that begin with `keyword`; each at most 4 kB of it."""
    at = text.find(keyword)
    while at >= 0:
        if not text[max(at - 64, 0) : at].replace(b"\r", b"\n").rpartition(b"\n")[2].strip():
            yield text[at : at + 4096].splitlines()[0]
        at = text.find(keyword, at + len(keyword))


def _gltf(path: str) -> bytes:
    """A glTF file; of a GLB no more than its JSON."""
    with Path(path).open("rb") as file:
        head = file.read(20)
        return head + file.read(int.from_bytes(head[12:16], "little") if head.startswith(b"glTF") else -1)


def _head(path: str) -> bytes:
    with Path(path).open("rb") as file:
        return file.read(HEAD)
