"""Wavefront MTL: materials by name. trimesh's reader is part of its OBJ reader, which ours replaces."""

from __future__ import annotations

import posixpath

import numpy as np

from b23d.stages.geometry.companions import image_name, relative
from b23d.stages.geometry.images import decode, find
from b23d.stages.geometry.surface import Material
from b23d.stages.geometry.text import numbers, plain, uncommented


def read_mtl(data: bytes, mtl_name: str, files: dict[str, bytes], problems: dict[str, int]) -> dict[bytes, Material]:
    """The materials of an MTL file by name: `map_Kd`, else `Kd` (taken as sRGB, as most programs write it).

    An image that is absent or unreadable leaves `Kd`, and is counted in `problems`.
    """
    folder = posixpath.dirname(mtl_name)
    materials: dict[bytes, Material] = {}
    current = Material()
    for line in plain(data).split(b"\n"):
        key, _, rest = line.strip().partition(b" ")
        key = key.lower()
        if key == b"newmtl":
            current = materials[rest.strip()] = Material()
        elif key == b"kd" and rest.split()[:1] not in ([b"spectral"], [b"xyz"]):
            values = np.clip(numbers(uncommented(rest), "Kd")[:3], 0, 1)
            if len(values):
                red, green, blue = (round(float(v) * 255) for v in (values if len(values) == 3 else values[[0, 0, 0]]))
                current.color = (red, green, blue)
        elif key == b"map_kd":
            name = relative(folder, image_name(rest))
            image = find(files, name) if name else None
            current.image = decode(image) if image else None
            if current.image is None:
                problems["missing_textures"] = problems.get("missing_textures", 0) + 1
    return materials
