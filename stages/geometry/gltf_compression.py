"""Compressed glTF: Draco's and meshoptimizer's own decoders, in packages that only such files need."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from b23d.stages.geometry.surface import MalformedError


def installed(package: str, extension: str) -> Any:
    """The package's module. Raises MalformedError that names the extra to install."""
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise MalformedError(
            f"{extension}: expected {package} to decode it, got no such package; pip install 'b23d[gltf]', or export "
            "the shape uncompressed"
        ) from error


def meshopt_view(data: bytes, packed: dict[str, Any]) -> bytes:
    """A buffer view's bytes out of `EXT_meshopt_compression`. Raises MalformedError."""
    meshoptimizer = installed("meshoptimizer", "EXT_meshopt_compression")
    count, stride, mode = packed["count"], packed["byteStride"], packed["mode"]
    buffer = np.frombuffer(data, np.uint8)
    try:
        if mode == "ATTRIBUTES":
            decoded = meshoptimizer.decode_vertex_buffer(count, stride, buffer, np.dtype(f"V{stride}"))
            filters = {"OCTAHEDRAL": "oct", "QUATERNION": "quat", "EXPONENTIAL": "exp"}
            if (chosen := packed.get("filter", "NONE")) != "NONE":
                decoded = getattr(meshoptimizer, f"decode_filter_{filters[chosen]}")(decoded, count, stride)
            return bytes(np.ascontiguousarray(decoded).tobytes())
        decode = {"TRIANGLES": meshoptimizer.decode_index_buffer, "INDICES": meshoptimizer.decode_index_sequence}[mode]
        return bytes(decode(count, 4, buffer)[:count].astype(f"<u{stride}").tobytes())
    except (ValueError, RuntimeError, KeyError, TypeError) as error:
        raise MalformedError(f"EXT_meshopt_compression: expected {mode} data, got {error}; export it again") from error


def draco_primitive(data: bytes, attributes: dict[str, int]) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Corners (c,) int64 and attributes (v, width) by glTF's names, out of `KHR_draco_mesh_compression`.

    `attributes`: glTF's name → Draco's id. Raises MalformedError.
    """
    draco = installed("DracoPy", "KHR_draco_mesh_compression")
    try:
        mesh = draco.decode(data)
        found = {
            name: np.asarray(mesh.get_attribute_by_unique_id(number)["data"]) for name, number in attributes.items()
        }
        corners = np.asarray(mesh.faces, np.int64).reshape(-1) if hasattr(mesh, "faces") else np.zeros(0, np.int64)
    except Exception as error:  # DracoPy has exceptions of its own for each stage
        raise MalformedError(f"KHR_draco_mesh_compression: expected a mesh, got {error}; export it again") from error
    return corners, {name: values.reshape(len(values), -1) for name, values in found.items()}
