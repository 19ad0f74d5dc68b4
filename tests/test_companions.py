"""The files that meshes name are found wherever the name stands and however it is written."""

from __future__ import annotations

import unicodedata
from pathlib import Path

import pytest

from b23d.stages.datasets.files import Companions
from tests.made_gltf import Gltf

OBJ = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def found(folder: Path, name: str, data: bytes, others: list[str]) -> list[str]:
    """The names under which the mesh's companions reach its reader."""
    for other in others:
        (folder / other).write_bytes(b"newmtl a\n" if other.lower().endswith(".mtl") else b"\0" * 200)
    (folder / name).write_bytes(data)
    return sorted(path.name for path in Companions([str(p) for p in folder.iterdir()]).of(str(folder / name)).values())


@pytest.mark.parametrize("before", [b"", OBJ * 4000])
def test_mtllib_lines_anywhere(tmp_path: Path, before: bytes) -> None:
    lines = b"mtllib red.mtl other.mtl\n# mtllib not.mtl\n" + OBJ * 5000 + b"\tmtllib my last.mtl\r\nf 1 2 3\n"
    names = ["red.mtl", "other.mtl", "my last.mtl", "not.mtl"]
    assert found(tmp_path, "a.obj", before + lines, names) == ["my last.mtl", "other.mtl", "red.mtl"]


def test_names_whose_accents_are_taken_apart(tmp_path: Path) -> None:
    stored = unicodedata.normalize("NFD", "grün.mtl")
    assert found(tmp_path, "a.obj", "mtllib GRÜN.mtl\n".encode() + OBJ, [stored]) == [stored]


def test_names_in_other_encodings(tmp_path: Path) -> None:
    assert found(tmp_path, "a.obj", "mtllib grün.mtl\n".encode("cp1252") + OBJ, ["grün.mtl"]) == ["grün.mtl"]
    assert found(tmp_path, "b.obj", ("mtllib grün.mtl\n" + OBJ.decode()).encode("utf-16"), []) == ["grün.mtl"]


def test_uris_with_percent_signs_in_text_and_binary(tmp_path: Path) -> None:
    document = Gltf()
    document.mesh()
    document.add("images", {"uri": "my%20pic%C3%BC.png"})
    names = ["a b.bin", "my picü.png", "as%20written.bin"]
    assert found(tmp_path, "a.gltf", document.gltf("a%20b.bin"), names) == ["a b.bin", "my picü.png"]
    assert found(tmp_path, "b.gltf", document.gltf("as%20written.bin"), []) == ["as%20written.bin", "my picü.png"]
    assert found(tmp_path, "c.glb", document.glb(), []) == ["my picü.png"]
