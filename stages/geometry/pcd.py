"""PCD, the Point Cloud Library's format. Our own reader because no kept one comes without PCL or Open3D, hundreds of
megabytes for one header."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from b23d.schemas.wording import counted
from b23d.stages.geometry.encoding import unmarked
from b23d.stages.geometry.lzf import decompress
from b23d.stages.geometry.surface import Cloud, MalformedError
from b23d.stages.geometry.text import numbers, plain, tokens_per_line, uncommented, without_commas


@dataclass
class PcdHeader:
    fields: list[str]
    """Names in lower case."""
    types: list[np.dtype]
    counts: list[int]
    """Values of each field in a row; PCL writes 0 for paddings of no bytes."""
    rows: int
    encoding: str
    end: int
    """Where the data begins, bytes."""
    lines: int
    """How many lines the header has."""


def read_pcd(data: bytes) -> Cloud:
    """The points of a PCD in the file's order, as stored (a VIEWPOINT says where the sensor was, and moves nothing).

    `rgb` or `rgba` is the packed colour, as integer or as the bits of a float. Raises MalformedError.
    """
    data = unmarked(data)
    header = _header(data)
    body = data[header.end :]
    read = {"ascii": _ascii, "binary": _binary, "binary_compressed": _compressed}.get(header.encoding)
    if read is None:
        raise MalformedError(
            f"line {header.lines}: expected DATA ascii, binary or binary_compressed, got {header.encoding[:40]}; "
            "convert it (pcl_convert_pcd_ascii_binary, Open3D)"
        )
    columns = read(header, body)
    points = np.stack([columns[header.fields.index(axis)] for axis in "xyz"], axis=1).astype(np.float64)
    packed = next((header.fields.index(name) for name in ("rgb", "rgba") if name in header.fields), None)
    colors = None if packed is None or not len(points) else _unpack(columns[packed])
    return Cloud(points, colors, problems=_behind(header, body))


def _header(data: bytes) -> PcdHeader:
    start = re.search(rb"(?i)(?:\A|[\r\n])DATA[ \t]+(\w+)[ \t]*(?:\r?\n|\r|\Z)", data)
    if start is None:
        raise MalformedError(
            "header: expected a PCD header that ends with `DATA ascii` or `DATA binary`, got none; is it a PCD file?"
        )
    lines = data[: start.start()].decode("latin-1").splitlines()
    header = {words[0].upper(): words[1:] for line in lines if (words := line.split())}
    fields = [name.lower() for name in header.get("FIELDS", header.get("COLUMNS", []))]
    try:
        counts = [int(n) for n in header.get("COUNT", ["1"] * len(fields))]
        sizes = [int(n) for n in header["SIZE"]]
        types = [_type(kind, size) for kind, size in zip(header["TYPE"], sizes, strict=True)]
        sides = [int(header[side][0]) for side in ("WIDTH", "HEIGHT") if side in header]
        rows = int(header["POINTS"][0]) if "POINTS" in header else int(np.prod(sides)) if len(sides) == 2 else -1
    except (ValueError, IndexError, KeyError, TypeError) as error:
        raise MalformedError(
            f"header: expected FIELDS, SIZE, TYPE (F, U, I), COUNT and POINTS, got {error}; convert it again"
        ) from error
    if not len(fields) == len(types) == len(counts):
        raise MalformedError(
            f"header: expected as many SIZE, TYPE and COUNT as FIELDS, got {len(types)} and {len(counts)} for "
            f"{len(fields)}; convert it again"
        )
    used = dict(zip(fields, counts, strict=True))
    placed = all(used.get(axis, 0) > 0 for axis in "xyz")
    if not placed or min(counts) < 0 or rows < 0:
        raise MalformedError(
            f"header: expected FIELDS with x y z and whole counts, got {' '.join(fields)}, {counted(rows, 'point')}; "
            "convert it again"
        )
    if len(sides) == 2 and sides[0] * sides[1] != rows:
        raise MalformedError(
            f"header: expected WIDTH × HEIGHT = POINTS, got {sides[0]} × {sides[1]} and {rows}; convert it again"
        )
    return PcdHeader(fields, types, counts, rows, start[1].decode().lower(), start.end(), len(lines) + 1)


def _type(kind: str, size: int) -> np.dtype:
    """Raises ValueError or TypeError: no F, U or I, or a size that it does not come in."""
    if kind.upper() not in ("F", "U", "I"):  # numpy would take some others, and parse the rest as Python
        raise ValueError(f"TYPE {kind[:20]}")
    return np.dtype(f"<{kind.lower()}{size}")


def _ascii(header: PcdHeader, body: bytes) -> list[np.ndarray]:
    """The first value of each field, (rows,) each."""
    text = uncommented(plain(body))
    lines = np.arange(header.lines + 1, header.lines + 1 + text.count(b"\n"))
    text = without_commas(text, "points", lines)
    widths = tokens_per_line(text)
    lines, full = lines[widths > 0], widths[widths > 0]
    width = sum(header.counts)
    if (wrong := np.flatnonzero(full != width)).size:
        raise MalformedError(
            f"line {lines[wrong[0]]}: expected {counted(header.rows, 'row')} of {counted(width, 'number')}, "
            f"got a row of {full[wrong[0]]}; "
            "copy the file again"
        )
    if len(full) != header.rows:
        raise MalformedError(
            f"points: expected {counted(header.rows, 'row')} of {counted(width, 'number')}, got {len(full)}; "
            "copy the file again"
        )
    values = numbers(text, "points", np.arange(header.lines + 1, header.lines + 1 + len(widths)))
    table = values.reshape(header.rows, width)
    first = np.cumsum(header.counts) - header.counts
    columns = [table[:, min(c, width - 1)] for c in first]
    with np.errstate(invalid="ignore"):
        return [c.astype(t) if t.kind != "f" else c for c, t in zip(columns, header.types, strict=True)]


def _binary(header: PcdHeader, body: bytes) -> list[np.ndarray]:
    sizes = [count * kind.itemsize for count, kind in zip(header.counts, header.types, strict=True)]
    stride = sum(sizes)
    if len(body) < header.rows * stride:
        raise MalformedError(
            f"points: expected {counted(header.rows * stride, 'byte')}, got {len(body)}; copy the file again"
        )
    places = np.cumsum(sizes) - sizes
    return [_column(header.rows, t, body, at, stride, n) for t, at, n in zip(header.types, places, sizes, strict=True)]


def _behind(header: PcdHeader, body: bytes) -> dict[str, int]:
    """How many bytes stand behind the points. Raises MalformedError where they would be more points."""
    if header.encoding == "ascii":
        return {}
    stride = sum(count * kind.itemsize for count, kind in zip(header.counts, header.types, strict=True))
    packed = header.encoding == "binary_compressed"
    used = 8 + int.from_bytes(body[:4], "little") if packed else header.rows * stride
    behind = body[used:]
    if not packed and len(behind) >= stride and any(behind):  # nothing but zeros is a writer's padding
        raise MalformedError(
            f"header: expected {counted(header.rows, 'point')}, as it says, "
            f"got a file that holds {len(body) // stride}; "
            "convert it again"
        )
    return {"trailing_bytes": len(behind)} if behind else {}


def _compressed(header: PcdHeader, body: bytes) -> list[np.ndarray]:
    """Two sizes, then LZF of all values of the first field, of the second, …"""
    packed, unpacked = (int.from_bytes(body[at : at + 4], "little") for at in (0, 4))
    sizes = [count * kind.itemsize for count, kind in zip(header.counts, header.types, strict=True)]
    if len(body) < 8 + packed or unpacked != header.rows * sum(sizes):
        raise MalformedError(
            f"points: expected {counted(header.rows * sum(sizes), 'byte')} in {packed} compressed ones, "
            f"got {unpacked} in {max(len(body) - 8, 0)}; copy the file again"
        )
    data = decompress(body[8 : 8 + packed], unpacked)
    places = (np.cumsum(sizes) - sizes) * header.rows
    strides = sizes
    return [
        _column(header.rows, t, data, at, stride, stride)
        for t, at, stride in zip(header.types, places, strides, strict=True)
    ]


def _column(rows: int, kind: np.dtype, data: bytes, at: int, stride: int, size: int) -> np.ndarray:
    """The first value of a field in each row; nothing but zeros where it has no bytes."""
    if not rows or not size:
        return np.zeros(rows, kind)
    return np.ndarray((rows,), kind, data, int(at), (stride,))


def _unpack(packed: np.ndarray) -> np.ndarray:
    """PCL's packed colour (…, 0xAARRGGBB) as (n, 3) uint8."""
    with np.errstate(invalid="ignore"):
        bits = (
            packed.astype(np.float32).view(np.uint32)
            if packed.dtype.kind == "f"
            else packed.astype(np.int64).astype(np.uint32)
        )
    return np.stack([(bits >> 16) & 255, (bits >> 8) & 255, bits & 255], axis=1).astype(np.uint8)
