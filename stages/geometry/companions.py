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

from b23d.stages.geometry.encoding import decoded, unmarked

MAP_OPTIONS = {
    **dict.fromkeys((b"-s", b"-o", b"-t"), 3),
    b"-mm": 2,
    **dict.fromkeys(
        (b"-bm", b"-blendu", b"-blendv", b"-cc", b"-clamp", b"-texres", b"-imfchan", b"-boost", b"-type"), 1
    ),
}
"""Options that may stand before the file name of `map_Kd`, and how many values each takes (at most, where it may
vary)."""


def material_files(obj: bytes) -> list[str]:
    """The MTL files an OBJ may mean, relative to it: where a line has blanks, the whole of it and its parts."""
    return [name for whole, parts in material_lines(obj) for name in dict.fromkeys([whole, *parts])]


def material_lines(obj: bytes) -> list[tuple[str, list[str]]]:
    """Each `mtllib` line of an OBJ: all of it as one name (which may have blanks), and as the several it may be."""
    lines = re.findall(rb"(?mi)^[ \t]*mtllib[ \t]+([^\r\n]+)", unmarked(obj))
    found = []
    for line in dict.fromkeys(lines):
        parts = re.findall(rb'"[^"]+"|\S.*?\.mtl(?=\s|$)|\S+', line, re.IGNORECASE)
        found += [(whole, _relative("", parts)) for whole in _relative("", [line])]
    return found


def texture_files(mtl: bytes, mtl_name: str) -> list[str]:
    """The diffuse images an MTL names, relative to the OBJ that names the MTL as `mtl_name`."""
    lines = re.findall(rb"(?mi)^[ \t]*map_Kd[ \t]+([^\r\n]+)", unmarked(mtl))
    return _relative(posixpath.dirname(mtl_name), [image_name(line) for line in lines])


def ply_textures(ply: bytes) -> list[str]:
    """The images a PLY's header names, in the order its texture numbers mean; relative to it."""
    ply = unmarked(ply)
    header = ply[: max(ply.find(b"end_header"), 0)]
    return _relative("", re.findall(rb"(?mi)^comment[ \t]+TextureFile[ \t]+([^\r\n]+)", header))


def gltf_files(gltf: bytes) -> list[str]:
    """The buffers and images a glTF or GLB names, relative to it; embedded ones are none. Empty where it is not
    JSON."""
    try:
        tree = json.loads(unmarked(gltf_json(gltf)))
        entries = [*tree.get("buffers", []), *tree.get("images", [])]
        uris = [entry["uri"] for entry in entries if not entry.get("uri", "data:").startswith("data:")]
    except (ValueError, AttributeError, TypeError, RecursionError):
        return []
    return _relative("", [name.encode() for uri in uris for name in uri_names(uri)])


def gltf_json(data: bytes) -> bytes:
    """The JSON of a glTF, or of a GLB, whose first chunk it is (as far as `data` goes)."""
    if not data.startswith(b"glTF"):
        return data
    return data[20 : 20 + int.from_bytes(data[12:16], "little")]


def uri_names(uri: str) -> list[str]:
    """The file names that a URI may mean: percent-decoded as the standard wants, and as written, also on Windows."""
    names = [unquote(uri), uri]
    return list(dict.fromkeys([*names, *(name.replace("\\", "/") for name in names)]))


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
    text = decoded(name).strip().strip('"').replace("\\", "/")
    if not text or text.startswith("/") or re.match(r"[A-Za-z]:", text) or "://" in text:
        return None
    return posixpath.normpath(posixpath.join(folder, text))


def _relative(folder: str, names: list[bytes]) -> list[str]:
    return list(dict.fromkeys(name for raw in names if (name := relative(folder, raw)) is not None))
