"""A glTF 2.0 document: its JSON, its buffers, and its accessors as arrays.

Our own reader, since the JSON must be read first: trimesh passes over what it does not know (sparse and normalized
accessors, fans, extensions that a file requires), and pygltflib reads no accessor.
"""

from __future__ import annotations

import base64
import json
from dataclasses import dataclass, field
from typing import Any
from urllib.parse import unquote_to_bytes

import numpy as np

from b23d.stages.geometry.companions import gltf_json, uri_names
from b23d.stages.geometry.encoding import unmarked
from b23d.stages.geometry.gltf_compression import meshopt_view
from b23d.stages.geometry.images import find
from b23d.stages.geometry.surface import MalformedError

KINDS = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
GEOMETRY = {
    *("KHR_mesh_quantization", "KHR_texture_transform", "EXT_mesh_gpu_instancing", "KHR_draco_mesh_compression"),
    "KHR_node_visibility",
    *MESHOPT,
}
APPEARANCE = (
    *("KHR_materials_", "EXT_materials_", "ADOBE_materials_", "EXT_texture_", "KHR_texture_basisu", "MSFT_texture_dds"),
    *("KHR_lights_", "EXT_lights_", "KHR_xmp", "KHR_animation_"),
)
"""Extensions that change colours at most, or nothing that a still shape has: a file that requires them can be read."""
MOST = 1 << 24
"""Numbers that the accessors of a small file may hold in all; of a large one, as many as it has bytes, and these."""


class JsonObject(dict[str, Any]):
    """A JSON object of a glTF. Raises MalformedError for a property that is read without a default, and is not
    there."""

    def __missing__(self, name: str) -> Any:
        there = ", ".join(map(str, self))[:200] or "nothing"
        raise MalformedError(f"JSON: expected an object with {name[:80]}, got one with {there}; export the shape again")


@dataclass
class Document:
    """A glTF's JSON with what it refers to."""

    tree: dict[str, Any]
    files: dict[str, bytes]
    chunk: bytes | None
    """A GLB's binary chunk."""
    left: int
    """How many more numbers may be read before the file is taken for a malicious one."""
    buffers: dict[int, bytes] = field(default_factory=dict)
    views: dict[int, tuple[bytes, int]] = field(default_factory=dict)

    @classmethod
    def of(cls, data: bytes, files: dict[str, bytes]) -> Document:
        """Read the JSON. Raises MalformedError: no glTF 2.0, or one that requires an extension unknown here."""
        chunk = None
        if data.startswith(b"glTF"):
            if int.from_bytes(data[4:8], "little") != 2 or data[16:20] != b"JSON":
                raise MalformedError("header: expected a binary glTF of version 2, got another; export it as glTF 2.0")
            behind = 20 + int.from_bytes(data[12:16], "little")
            if behind > len(data):
                raise MalformedError(f"header: expected {behind} bytes, got {len(data)}; copy or export it again")
            if data[behind + 4 : behind + 8] == b"BIN\0":
                chunk = data[behind + 8 : behind + 8 + int.from_bytes(data[behind : behind + 4], "little")]
        try:
            tree = json.loads(unmarked(gltf_json(data)), object_hook=JsonObject)
        except (ValueError, RecursionError) as error:
            raise MalformedError(
                f"JSON: expected glTF's, got {type(error).__name__}: {error}; export it again"
            ) from error
        if not isinstance(tree, dict) or not str(tree.get("asset", {}).get("version", "")).startswith("2"):
            raise MalformedError("asset: expected version 2.0, got another; export it as glTF 2.0")
        for name in tree.get("extensionsRequired", []):
            if name not in GEOMETRY and not str(name).startswith(APPEARANCE):
                raise MalformedError(
                    f"extensionsRequired: expected extensions known here, got {name}; export the shape without it"
                )
        everything = len(data) + sum(map(len, files.values()))
        return cls(tree, files, chunk, MOST + everything)

    def entry(self, kind: str, index: Any) -> dict[str, Any]:
        """`tree[kind][index]`. Raises MalformedError where there is none."""
        entries = self.tree.get(kind, [])
        if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(entries):
            raise MalformedError(f"{kind}: expected an entry {index}, got {len(entries)}; export the shape again")
        entry: dict[str, Any] = entries[index]
        return entry

    def requires(self, extension: str) -> bool:
        return extension in self.tree.get("extensionsRequired", [])

    def spend(self, numbers: int) -> None:
        """Count numbers that are about to be made. Raises MalformedError where no honest file has as many."""
        self.left -= numbers
        if numbers < 0 or self.left < 0:
            raise MalformedError(
                "scene: expected numbers that the file's size explains, got many times as many; use fewer instances"
            )

    def uri(self, uri: str) -> bytes | None:
        """What a URI names: itself, if it is data, or one of the shape's files; None where that is absent."""
        if uri.startswith("data:"):
            head, _, data = uri.partition(",")
            try:
                return base64.b64decode(unquote_to_bytes(data)) if head.endswith(";base64") else unquote_to_bytes(data)
            except ValueError as error:
                raise MalformedError(f"data URI: expected base64, got {error}; export the shape again") from error
        return next((found for name in uri_names(uri) if (found := find(self.files, name)) is not None), None)

    def buffer(self, index: int) -> bytes:
        """A buffer's bytes. Raises MalformedError where its file is absent or shorter than announced."""
        if index not in self.buffers:
            entry = self.entry("buffers", index)
            uri = entry.get("uri")
            data = self.uri(str(uri)) if uri is not None else self.chunk if index == 0 else None
            if data is None:
                raise MalformedError(
                    f"buffer {index}: expected {str(uri)[:80] if uri else 'a binary chunk'} among the shape's files, "
                    f"got {', '.join(sorted(self.files)) or 'none'}; add the file"
                )
            if len(data) < entry["byteLength"]:
                raise MalformedError(
                    f"buffer {index}: expected {entry['byteLength']} bytes, got {len(data)}; copy or export it again"
                )
            self.buffers[index] = data
        return self.buffers[index]

    def view(self, index: int) -> tuple[bytes, int]:
        """A buffer view's bytes, decompressed, and its stride (0: none). Raises MalformedError."""
        if index not in self.views:
            entry = self.entry("bufferViews", index)
            packed = next((found for name in MESHOPT if (found := entry.get("extensions", {}).get(name))), None)
            if packed is not None:
                self.spend(packed["count"] * packed["byteStride"] // 4)
                data = meshopt_view(self._slice(packed, index), packed)
            else:
                data = self._slice(entry, index)
            self.views[index] = (data, entry.get("byteStride", 0))
        return self.views[index]

    def _slice(self, entry: dict[str, Any], index: int) -> bytes:
        start, size, data = entry.get("byteOffset", 0), entry["byteLength"], self.buffer(entry["buffer"])
        if start < 0 or size < 0 or start + size > len(data):
            raise MalformedError(
                f"bufferView {index}: expected bytes {start} to {start + size} of a buffer, got {len(data)}; "
                "export the shape again"
            )
        return data[start : start + size]

    def raw(self, index: int) -> np.ndarray:
        """An accessor's numbers (count, width) in the type they are stored in, sparse ones in place."""
        entry = self.entry("accessors", index)
        count, width, kind = entry["count"], _width(entry["type"]), _kind(entry["componentType"])
        self.spend(count * width)
        if "bufferView" in entry:
            values = self._strided(
                entry["bufferView"], entry.get("byteOffset", 0), kind, count, width, f"accessor {index}"
            )
        else:
            values = np.zeros((count, width), kind)
        if "sparse" in entry:
            sparse = entry["sparse"]
            few, where, what = sparse["count"], sparse["indices"], sparse["values"]
            name = f"sparse accessor {index}"
            of_index = _kind(where["componentType"])
            places = self._strided(where["bufferView"], where.get("byteOffset", 0), of_index, few, 1, name)[:, 0]
            if few and places.max() >= count:
                raise MalformedError(f"{name}: expected places below {count}, got {places.max()}; export it again")
            values = values.copy()
            values[places] = self._strided(what["bufferView"], what.get("byteOffset", 0), kind, few, width, name)
        return values

    def floats(self, index: int) -> np.ndarray:
        """An accessor's numbers (count, width) float64, normalized ones within [-1, 1]."""
        values = self.raw(index)
        if not self.entry("accessors", index).get("normalized", False) or values.dtype.kind == "f":
            with np.errstate(invalid="ignore"):  # signalling NaN
                return values.astype(np.float64)
        return np.maximum(values / float(np.iinfo(values.dtype).max), -1.0)

    def _strided(self, view: int, offset: int, kind: np.dtype, count: int, width: int, name: str) -> np.ndarray:
        data, stride = self.view(view)
        stride = stride or kind.itemsize * width
        last = offset + (count - 1) * stride + kind.itemsize * width if count else 0
        if count < 0 or offset < 0 or stride < 1 or last > len(data):
            raise MalformedError(f"{name}: expected {last} bytes, got a view of {len(data)}; export the shape again")
        return np.ndarray((count, width), kind, data, offset if count else 0, (stride, kind.itemsize))


def _kind(code: Any) -> np.dtype:
    """The numpy type of a componentType. Raises MalformedError."""
    if not isinstance(code, int) or code not in KINDS:
        raise MalformedError(
            f"accessor: expected a componentType of {', '.join(map(str, KINDS))}, got {str(code)[:40]}; "
            "export the shape again"
        )
    return np.dtype("<" + KINDS[code])


def _width(kind: Any) -> int:
    """Numbers in each element of an accessor's type. Raises MalformedError."""
    if not isinstance(kind, str) or kind not in WIDTHS:
        raise MalformedError(
            f"accessor: expected a type of {', '.join(WIDTHS)}, got {str(kind)[:40]}; export the shape again"
        )
    return WIDTHS[kind]
