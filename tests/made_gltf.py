"""glTF files made by hand for tests: accessors in every spelling, text or binary."""

from __future__ import annotations

import base64
import json
from typing import Any

import numpy as np

CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
TABLE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float32)
QUAD = np.array([0, 1, 2, 0, 2, 3], np.uint16)


class Gltf:
    """A glTF that grows: `tree` is its JSON, `data` its one buffer."""

    def __init__(self) -> None:
        self.tree: dict[str, Any] = {"asset": {"version": "2.0"}, "accessors": [], "bufferViews": []}
        self.data = bytearray()

    def view(self, data: bytes, **more: Any) -> int:
        self.data += bytes(-len(self.data) % 4)
        self.tree["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more})
        self.data += data
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, values: np.ndarray, stride: int = 0, sparse: str = "", **more: Any) -> int:
        """`sparse`: "" for none, "base" over false numbers, "zeros" over no view at all."""
        values = values.reshape(len(values), -1)
        wide, entry = values.itemsize * values.shape[1], {"type": TYPES[values.shape[1]], "count": len(values)}
        entry |= {"componentType": CODES[values.dtype.str[1:]], **more}
        if sparse:
            places = np.arange(len(values), dtype=np.uint16)
            entry["sparse"] = {
                "count": len(values),
                "indices": {"bufferView": self.view(places.tobytes()), "componentType": 5123},
                "values": {"bufferView": self.view(values.tobytes())},
            }
            values = np.zeros_like(values)
        if sparse != "zeros":
            rows = np.zeros((len(values), max(stride, wide)), np.uint8)
            rows[:, :wide] = np.ascontiguousarray(values).view(np.uint8).reshape(len(values), wide)
            entry["bufferView"] = self.view(rows.tobytes(), **({"byteStride": stride} if stride else {}))
        self.tree["accessors"].append(entry)
        return len(self.tree["accessors"]) - 1

    def add(self, kind: str, entry: dict[str, Any]) -> int:
        self.tree.setdefault(kind, []).append(entry)
        return len(self.tree[kind]) - 1

    def mesh(self, points: np.ndarray = TABLE, index: np.ndarray | None = QUAD, **more: Any) -> int:
        """A mesh of one primitive; `more` goes into the primitive, `attributes` beside the positions."""
        attributes = {"POSITION": self.accessor(points), **more.pop("attributes", {})}
        indices = {} if index is None else {"indices": self.accessor(index)}
        return self.add("meshes", {"primitives": [{"attributes": attributes, **indices, **more}]})

    def glb(self) -> bytes:
        """As GLB; every node is a root where there are no scenes."""
        self.tree["buffers"] = [{"byteLength": len(self.data)}]
        text = json.dumps(self.tree).encode()
        text += b" " * (-len(text) % 4)
        data = bytes(self.data) + bytes(-len(self.data) % 4)
        chunks = [(text, b"JSON"), (data, b"BIN\0")]
        body = b"".join(len(chunk).to_bytes(4, "little") + name + chunk for chunk, name in chunks)
        return b"glTF" + (2).to_bytes(4, "little") + (12 + len(body)).to_bytes(4, "little") + body

    def gltf(self, uri: str | None = None) -> bytes:
        """As text, its buffer at `uri`, or within."""
        within = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        self.tree["buffers"] = [{"byteLength": len(self.data), "uri": uri or within}]
        return json.dumps(self.tree).encode()
