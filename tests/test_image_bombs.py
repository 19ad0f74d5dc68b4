"""Images of few bytes that promise many pixels: refused by their header, before any pixel is decoded, and counted."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

import numpy as np
import pytest
from PIL import Image, ImageFile

from b23d.stages.geometry.images import PIXELS, decode
from tests.made_gltf import TABLE, Gltf
from tests.reading import surface

OBJ = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nusemtl m\nf 1/1 2/2 3/3\n"
PLY = (
    b"ply\nformat ascii 1.0\ncomment TextureFile a.png\nelement vertex 3\n"
    b"property float x\nproperty float y\nproperty float z\nproperty float s\nproperty float t\n"
    b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    b"0 0 0 0 0\n1 0 0 1 0\n0 1 0 1 1\n3 0 1 2\n"
)


def png(width: int, height: int, rows: int | None = None) -> bytes:
    """A black PNG of one bit a pixel, right unless it holds fewer rows than it promises."""
    pixels = zlib.compress(bytes((1 + (width + 7) // 8) * (height if rows is None else rows)))
    chunks = ((b"IHDR", struct.pack(">IIBBBBB", width, height, 1, 0, 0, 0, 0)), (b"IDAT", pixels), (b"IEND", b""))
    made = b"\x89PNG\r\n\x1a\n"
    for kind, body in chunks:
        made += struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
    return made


BOMB = png(8193, 8192)
"""One column too many; 8 kB."""


@pytest.fixture
def decoded(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[tuple[int, int]]]:
    """The size of each image that is decoded meanwhile."""
    sizes: list[tuple[int, int]] = []
    load = ImageFile.ImageFile.load

    def noted(image: ImageFile.ImageFile) -> object:
        sizes.append(image.size)
        return load(image)

    monkeypatch.setattr(ImageFile.ImageFile, "load", noted)
    yield sizes


def test_a_bomb_is_refused_by_its_header(decoded: list[tuple[int, int]]) -> None:
    assert len(BOMB) < 10_000 and PIXELS < 8193 * 8192
    assert decode(BOMB) is None and decode(png(2**31 - 1, 2**31 - 1, rows=1)) is None and not decoded
    pixels = decode(png(16, 8))
    assert pixels is not None and pixels.shape == (8, 16, 3) and decoded


@pytest.mark.filterwarnings("error")
def test_a_bomb_that_pillow_warns_of() -> None:
    side = int(Image.MAX_IMAGE_PIXELS or 0) // 1000
    assert decode(png(side, 1001, rows=1)) is None


@pytest.mark.parametrize(("image", "missing"), [(BOMB, 1), (png(16, 8), 0)], ids=["bomb", "image"])
def test_every_reader_counts_it(image: bytes, missing: int, decoded: list[tuple[int, int]]) -> None:
    document = Gltf()
    document.mesh(attributes={"TEXCOORD_0": document.accessor(np.zeros((len(TABLE), 2), np.float32))}, material=0)
    document.add("nodes", {"mesh": 0})
    document.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    document.add("textures", {"source": 0})
    document.tree["images"] = [{"bufferView": document.view(image)}]
    mtl = b"newmtl m\nmap_Kd a.png\n"
    for read in (
        surface(document.glb(), "m.glb"),
        surface(OBJ, "m.obj", {"a.mtl": mtl, "a.png": image}),
        surface(PLY, "m.ply", {"a.png": image}),
    ):
        assert read.problems.get("missing_textures", 0) == missing and len(read.faces)
    assert bool(decoded) == (missing == 0)
