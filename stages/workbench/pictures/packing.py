"""Arrays as text inside a page: zlib, then base64. `static/details.js` reads them."""

from __future__ import annotations

import base64
import json
import zlib
from functools import cache
from typing import Any

import numpy as np

STEPS = 4095  # of a shape's longest side: a tenth of the distance between candidates and less
BITS = 10  # of each coordinate on the curve: far finer than candidates are apart
UNSAFE = (0, ord("\r"), ord("<"))  # a page replaces the first two, and the last may end the script
DTYPES = ("uint8", "int8", "uint16", "int16", "int32", "float32")


def pack(array: np.ndarray) -> dict[str, Any]:
    """`{"dtype", "shape", "data"}` of an array of any shape in C order; bool goes as uint8.

    Raises TypeError for a dtype that a browser's typed arrays do not have.
    """
    array = np.ascontiguousarray(array)
    if array.dtype == bool:
        array = array.astype(np.uint8)
    if array.dtype.name not in DTYPES:
        raise TypeError(f"packed array: expected one of {', '.join(DTYPES)}, got {array.dtype}; convert it first")
    data = zlib.compress(array.astype(array.dtype.newbyteorder("<")).tobytes(), 9)
    return {"dtype": array.dtype.name, "shape": list(array.shape), "data": base64.b64encode(data).decode("ascii")}


def curve_order(points: np.ndarray) -> np.ndarray:
    """Indices (n,) of points (n, 3) along a Morton (z-order) curve through their bounding cube."""
    low, side = points.min(axis=0), float(np.ptp(points, axis=0).max()) or 1.0
    cells = ((points - low) / side * (2**BITS - 1)).astype(np.uint64)
    key = np.zeros(len(points), np.uint64)
    for bit in range(BITS):
        for axis in range(3):
            key |= ((cells[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(key, kind="stable")


def data_uri(data: bytes, kind: str) -> str:
    """A file's bytes as an address that needs no file, e.g. of kind `image/webp`."""
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def pack_places(points: np.ndarray) -> dict[str, Any]:
    """`{"low", "side", "steps"}` of points (n, 3): each one's difference from the one before
    in 4,095 steps of a cube's side, from its lowest corner."""
    low, side = points.min(axis=0), float(np.ptp(points, axis=0).max()) or 1.0
    steps = np.round((points - low) / side * STEPS).astype(np.int32)
    differences = np.diff(steps, axis=0, prepend=0).astype(np.uint16)  # wraps
    return {"low": [float(x) for x in low], "side": side, "steps": pack(differences)}


@cache
def packed_plotly() -> str:
    """The plotting library as text for `static/library.js`: 2 MB in place of 5."""
    from plotly.offline import get_plotlyjs

    return as_text(zlib.compress(get_plotlyjs().encode(), 9))


def as_text(data: bytes) -> str:
    """Bytes as text that may stand in a script element of a UTF-8 page, a sixth longer than they are (base64: a third).

    Seven bits a character, most significant first, zeros at the end; the three that a page cannot hold have 128 added.
    """
    bits = np.unpackbits(np.frombuffer(data, np.uint8))
    septets = np.packbits(np.pad(bits, (0, -len(bits) % 7)).reshape(-1, 7), axis=1)[:, 0] >> 1
    return np.where(np.isin(septets, UNSAFE), septets + 128, septets).astype(np.uint8).tobytes().decode("latin-1")


def as_json(value: Any) -> str:
    """JSON that may stand inside a script element: no `<` survives as such. NaN and infinities are errors."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
