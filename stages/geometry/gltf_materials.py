"""glTF's materials: base colour times base texture, and how texture coordinates are moved."""

from __future__ import annotations

from typing import Any

import numpy as np

from b23d.stages.geometry.gltf_document import Document
from b23d.stages.geometry.images import decode
from b23d.stages.geometry.surface import Material, to_uint8

SOURCES = ("EXT_texture_webp", "EXT_texture_avif", "MSFT_texture_dds", "KHR_texture_basisu")
"""Extensions that hold a texture's image in another format; Pillow reads the first ones, KTX2 no kept library does."""


def texture_info(document: Document, index: int) -> tuple[dict[str, Any] | None, np.ndarray | None, bool]:
    """A material's base texture as its JSON has it (None: none), its base factor (3,) linear light (None: none), and
    whether it is opaque; of the older specular-glossiness materials their diffuse ones."""
    entry = document.entry("materials", index)
    old = entry.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
    if old is not None:
        texture, factor = old.get("diffuseTexture"), old.get("diffuseFactor")
    else:
        metallic = entry.get("pbrMetallicRoughness", {})
        texture, factor = metallic.get("baseColorTexture"), metallic.get("baseColorFactor")
    linear = None if factor is None else np.clip(np.asarray(factor, np.float64)[:3], 0, 1)
    return texture, linear, entry.get("alphaMode", "OPAQUE") == "OPAQUE"


def material(document: Document, index: int, problems: dict[str, int]) -> Material:
    """A material. An image that is absent or of a format nobody here reads leaves the factor, and is counted."""
    texture, linear, opaque = texture_info(document, index)
    pixels = None if texture is None else _image(document, texture["index"], opaque)
    if texture is not None and pixels is None:
        problems["missing_textures"] = problems.get("missing_textures", 0) + 1
    if pixels is not None:
        return Material(image=tinted(pixels, linear))
    if linear is None:
        return Material()
    red, green, blue = (int(c) for c in np.rint(_srgb(linear) * 255))
    return Material(color=(red, green, blue))


def tinted(colors: np.ndarray, linear: np.ndarray | None) -> np.ndarray:
    """sRGB colours (…, 3) uint8 times a factor (3,) of linear light."""
    if linear is None or (linear >= 1).all():
        return colors
    return to_uint8(_srgb(_linear(colors / 255.0) * linear) * 255)


def moved_uvs(uvs: np.ndarray, texture: dict[str, Any]) -> np.ndarray:
    """(v, 2) after KHR_texture_transform, with the origin at the lower left, as everywhere but in glTF.

    Coordinates turn counter-clockwise as seen on the image, whose v grows downwards: so viewers do. The listing in the
    extension's text turns them the other way (https://github.com/KhronosGroup/glTF/issues/1563).
    """
    transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
    scaled = uvs * np.asarray(transform.get("scale", [1, 1]), np.float64)
    cosine, sine = np.cos(transform.get("rotation", 0.0)), np.sin(transform.get("rotation", 0.0))
    turned = np.stack(
        [cosine * scaled[:, 0] + sine * scaled[:, 1], cosine * scaled[:, 1] - sine * scaled[:, 0]], axis=1
    )
    placed = turned + np.asarray(transform.get("offset", [0, 0]), np.float64)
    return np.stack([placed[:, 0], 1 - placed[:, 1]], axis=1)


def uv_set(texture: dict[str, Any]) -> str:
    """The attribute that a texture's coordinates are in."""
    transform = texture.get("extensions", {}).get("KHR_texture_transform", {})
    return f"TEXCOORD_{transform.get('texCoord', texture.get('texCoord', 0))}"


def _image(document: Document, index: int, opaque: bool) -> np.ndarray | None:
    """A texture's image (h, w, 3) uint8, of the first of its sources that can be read; None where none can."""
    entry = document.entry("textures", index)
    extensions = entry.get("extensions", {})
    for source in [*(extensions[name].get("source") for name in SOURCES if name in extensions), entry.get("source")]:
        if source is None:
            continue
        image = document.entry("images", source)
        data = document.view(image["bufferView"])[0] if "bufferView" in image else document.uri(image.get("uri", ""))
        if data is not None and (pixels := decode(data, opaque)) is not None:
            return pixels
    return None


def _srgb(linear: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1, values in [0, 1]."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def _linear(srgb: np.ndarray) -> np.ndarray:
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
