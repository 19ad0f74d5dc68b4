"""Texture images from bytes, and files by the names that other files call them."""

from __future__ import annotations

import io
import posixpath

import numpy as np
from PIL import Image

from b23d.stages.geometry.encoding import alike

LARGEST = 1024
"""Longest side of a texture, pixels: views are a few hundred pixels wide, and more would only be stored."""
PIXELS = 8192**2
"""Pixels of the largest image that is decoded, 256 MB: a file of a few bytes may promise any number."""


def find(files: dict[str, bytes], name: str) -> bytes | None:
    """The file called `name`; else the only one with its name in any folder and any case (exporters disagree on
    both), however accents are stored."""
    if name in files:
        return files[name]
    base = alike(posixpath.basename(name))
    found = [data for other, data in files.items() if alike(posixpath.basename(other)) == base]
    return found[0] if len(found) == 1 else None


def decode(data: bytes, opaque: bool = False) -> np.ndarray | None:
    """An image file as (h, w, 3) uint8, first row on top, transparent parts white unless `opaque`; None where it
    cannot be read or its header promises more than `PIXELS`."""
    try:
        with Image.open(io.BytesIO(data)) as image:  # reads the header only
            if image.width * image.height > PIXELS:
                return None
            image.load()
            return flatten(image, opaque)
    except (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError, Image.DecompressionBombWarning):
        return None


def flatten(image: Image.Image, opaque: bool = False) -> np.ndarray:
    """An image as (h, w, 3) uint8 of at most `LARGEST` a side, laid over white unless its alpha means nothing
    (`opaque`)."""
    has_alpha = image.mode in ("RGBA", "LA", "PA", "La", "RGBa") or "transparency" in image.info
    mode = "RGBA" if has_alpha and not opaque else "RGB"
    image = image if image.mode == mode else image.convert(mode)
    if max(image.size) > LARGEST:
        ratio = LARGEST / max(image.size)
        image = image.resize(
            (max(1, round(image.width * ratio)), max(1, round(image.height * ratio))), Image.Resampling.BOX
        )
    if image.mode == "RGBA":
        image = Image.alpha_composite(Image.new("RGBA", image.size, (255, 255, 255, 255)), image).convert("RGB")
    return np.array(image)
