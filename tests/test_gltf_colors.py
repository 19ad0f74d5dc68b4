"""glTF's colours: factors, images, vertex colours and how texture coordinates are moved."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from PIL import Image

from b23d.stages.geometry.surface import Surface
from tests.made_gltf import TABLE, Gltf
from tests.reading import surface

QUARTERS = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8)
"""Red and green above, blue and white below."""


def encoded(kind: str, pixels: np.ndarray = QUARTERS) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(np.kron(pixels, np.ones((16, 16, 1), np.uint8))).save(
        buffer, kind, **({"lossless": True} if kind == "webp" else {})
    )
    return buffer.getvalue()


def textured(uvs: np.ndarray, name: str = "TEXCOORD_0", info: dict[str, Any] | None = None, **texture: Any) -> Gltf:
    document = Gltf()
    document.mesh(attributes={name: document.accessor(uvs)}, material=0)
    document.add("images", {"bufferView": document.view(encoded("png")), "mimeType": "image/png"})
    document.add("textures", texture or {"source": 0})
    base = {"index": 0, **(info or {})}
    document.add("materials", {"pbrMetallicRoughness": {"baseColorTexture": base}})
    document.add("nodes", {"mesh": 0})
    return document


def seen(document: Gltf) -> list[int]:
    """The colour in the middle of the first face."""
    read = surface(document.glb(), "m.glb")
    assert read.face_uvs is not None
    image = read.materials[0].image
    assert image is not None
    u, v = read.face_uvs[0].mean(axis=0)
    return image[int((1 - v) % 1 * len(image)), int(u % 1 * len(image[0]))].tolist()


def place(u: float, v: float) -> np.ndarray:
    """All corners at one place of the image; v grows downwards."""
    return np.full((4, 2), [u, v], np.float32)


RED, GREEN, BLUE = [255, 0, 0], [0, 255, 0], [0, 0, 255]


@pytest.mark.parametrize(("at", "color"), [((0.25, 0.25), RED), ((0.75, 0.25), GREEN), ((0.25, 0.75), BLUE)])
def test_coordinates_begin_at_the_upper_left(at: tuple[float, float], color: list[int]) -> None:
    assert seen(textured(place(*at))) == color


@pytest.mark.parametrize(
    ("transform", "color"),
    [
        ({"offset": [0.5, 0]}, GREEN),
        ({"offset": [0, 0.5]}, BLUE),
        ({"scale": [3, 1]}, GREEN),
        ({"rotation": np.pi / 2, "offset": [0, 1]}, BLUE),  # (u, v) → (v, 1 - u): a quarter turn counter-clockwise
        ({"rotation": -np.pi / 2, "offset": [1, 0]}, GREEN),
        ({}, RED),
    ],
)
def test_texture_transform(transform: dict[str, Any], color: list[int]) -> None:
    info = {"extensions": {"KHR_texture_transform": transform}}
    assert seen(textured(place(0.25, 0.25), info=info)) == color


def test_the_set_of_coordinates_that_the_texture_asks_for() -> None:
    document = textured(place(0.25, 0.25), info={"texCoord": 1})
    attributes = document.tree["meshes"][0]["primitives"][0]["attributes"]
    attributes["TEXCOORD_1"] = document.accessor(place(0.25, 0.75))
    assert seen(document) == BLUE
    base = document.tree["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    base["extensions"] = {"KHR_texture_transform": {"texCoord": 2}}
    attributes["TEXCOORD_2"] = document.accessor((place(0.75, 0.25) * 65535).astype(np.uint16), normalized=True)
    assert seen(document) == GREEN
    base["extensions"]["KHR_texture_transform"]["texCoord"] = 3
    assert surface(document.glb(), "m.glb").problems == {"missing_texture_coordinates": 1}


@pytest.mark.parametrize("kind", ["webp", "jpeg"])
def test_images_of_other_formats(kind: str) -> None:
    document = textured(place(0.75, 0.25), source=1, extensions={"EXT_texture_webp": {"source": 0}})
    document.tree["images"] = [{"bufferView": document.view(encoded(kind))}]
    document.tree["extensionsRequired"] = ["EXT_texture_webp"]
    assert np.abs(np.array(seen(document)) - GREEN).max() <= 6


def test_an_image_that_cannot_be_read_is_counted() -> None:
    document = textured(place(0, 0), extensions={"KHR_texture_basisu": {"source": 0}})
    document.tree["images"] = [{"bufferView": document.view(b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(80))}]
    document.tree["extensionsRequired"] = ["KHR_texture_basisu"]
    document.tree["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [1, 0, 0, 1]
    read = surface(document.glb(), "m.glb")
    assert read.problems == {"missing_textures": 1}
    assert read.materials[0].color == (255, 0, 0)


def colored(values: np.ndarray, factor: list[float] | None = None, **more: Any) -> Surface:
    document = Gltf()
    document.mesh(attributes={"COLOR_0": document.accessor(values, **more)}, **({"material": 0} if factor else {}))
    document.add("nodes", {"mesh": 0})
    if factor:
        document.add("materials", {"pbrMetallicRoughness": {"baseColorFactor": factor}})
    return surface(document.glb(), "m.glb")


@pytest.mark.parametrize("width", [3, 4])
@pytest.mark.parametrize("kind", ["u1", "u2", "f4"])
def test_vertex_colors_in_every_type_times_the_factor(kind: str, width: int) -> None:
    most = 1 if kind == "f4" else np.iinfo(kind).max
    values = (np.array([[1, 0, 1, 1]] * len(TABLE))[:, :width] * most).astype(kind)
    plain = colored(values, normalized=kind != "f4", stride=16)
    assert plain.vertex_colors is not None
    assert plain.vertex_colors.tolist() == [[255, 0, 255]] * 4
    half = colored(values, factor=[0.2140, 1, 1, 1], normalized=kind != "f4")
    assert half.vertex_colors is not None
    np.testing.assert_allclose(half.vertex_colors, [[128, 0, 255]] * 4, atol=1)  # .214 of linear light is half of sRGB
