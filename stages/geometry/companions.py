"""Which other files a mesh file names: an OBJ its MTLs, an MTL its images, a PLY its textures, a glTF its buffers and
images.

Names are kept relative to the mesh file, with `/`; absolute ones (some exporters write `K:/images/…`) are dropped, so
that no path of a machine is followed or enters an address. Standard library only: listing a data set reads these.
"""

from __future__ import annotations

import json
import posixpath
import re
from urllib.parse import unquote

MAP_OPTIONS = {b"-s": 3, b"-o": 3, b"-t": 3, b"-mm": 2, b"-bm": 1, b"-blendu": 1, b"-blendv": 1, b"-cc": 1,
               b"-clamp": 1, b"-texres": 1, b"-imfchan": 1, b"-boost": 1, b"-type": 1}  # fmt: skip
"""Options that may stand before the file name of `map_Kd`, and how many values each takes (at most, where it may
vary)."""


def material_files(obj: bytes) -> list[str]:
    """The MTL files an OBJ names, relative to it."""
    names = re.findall(rb"(?m)^[ \t]*mtllib[ \t]+([^\r\n]+)", obj)
    return _relative("", names)


def texture_files(mtl: bytes, mtl_name: str) -> list[str]:
    """The diffuse images an MTL names, relative to the OBJ that names the MTL as `mtl_name`."""
    lines = re.findall(rb"(?mi)^[ \t]*map_Kd[ \t]+([^\r\n]+)", mtl)
    return _relative(posixpath.dirname(mtl_name), [image_name(line) for line in lines])


def ply_textures(ply: bytes) -> list[str]:
    """The images a PLY's header names, in the order its texture numbers mean; relative to it."""
    header = ply[: max(ply.find(b"end_header"), 0)]
    return _relative("", re.findall(rb"(?mi)^comment[ \t]+TextureFile[ \t]+([^\r\n]+)", header))


def gltf_files(gltf: bytes) -> list[str]:
    """The buffers and images a glTF (JSON) names, relative to it; embedded ones are none. Empty where it is not
    JSON."""
    try:
        tree = json.loads(gltf)
        entries = [*tree.get("buffers", []), *tree.get("images", [])]
        uris = [entry["uri"] for entry in entries if not entry.get("uri", "data:").startswith("data:")]
    except (ValueError, AttributeError, TypeError):
        return []
    return _relative("", [unquote(uri).encode() for uri in uris])


def image_name(line: bytes) -> bytes:
    """The file name of a `map_Kd` line: without the options before it and the comment behind it."""
    line = re.split(rb"#[ \t]", line, maxsplit=1)[
        0
    ].strip()  # files joined without a line end: `wood.jpg# Blender MTL File`
    tokens = line.split()
    while tokens and tokens[0].lower() in MAP_OPTIONS:
        values = MAP_OPTIONS[tokens.pop(0).lower()]
        while values and len(tokens) > 1 and re.fullmatch(rb"[-+.\deE]+|on|off", tokens[0]):
            tokens.pop(0)
            values -= 1
        line = b" ".join(tokens)
    return line


def relative(folder: str, name: bytes) -> str | None:
    """`name` as a file in `folder` would name it, normalized and with `/`; None for an absolute name."""
    text = name.decode("utf-8", "replace").strip().strip('"').replace("\\", "/")
    if not text or text.startswith("/") or re.match(r"[A-Za-z]:", text) or "://" in text:
        return None
    return posixpath.normpath(posixpath.join(folder, text))


def _relative(folder: str, names: list[bytes]) -> list[str]:
    return list(dict.fromkeys(name for raw in names if (name := relative(folder, raw)) is not None))
