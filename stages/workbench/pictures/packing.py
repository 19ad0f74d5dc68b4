"""Arrays as text inside a page: zlib, then base64. `static/details.js` reads them."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np

DTYPES = ("uint8", "int8", "uint16", "int16", "int32", "float16", "float32")


def pack(array: np.ndarray) -> dict[str, Any]:
    """`{"dtype", "shape", "data"}` of an array of any shape in C order; bool goes as uint8.

    Raises TypeError for a dtype that a browser's typed arrays do not have.
    """
    array = np.ascontiguousarray(array)
    if array.dtype == bool:
        array = array.astype(np.uint8)
    if array.dtype.name not in DTYPES:
        raise TypeError(f"packed array: expected one of {', '.join(DTYPES)}, got {array.dtype}; convert it first")
    data = zlib.compress(array.astype(array.dtype.newbyteorder("<")).tobytes(), 6)
    return {"dtype": array.dtype.name, "shape": list(array.shape), "data": base64.b64encode(data).decode("ascii")}


def data_uri(data: bytes, kind: str) -> str:
    """A file's bytes as an address that needs no file, e.g. of kind `image/webp`."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"
