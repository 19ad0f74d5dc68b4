"""Point clouds: PCD (ASCII and binary), XYZ, NPZ. Their points keep the file's order, since keypoints count them."""

from __future__ import annotations

import io
import re
import zipfile

import numpy as np

from b23d.stages.geometry.surface import Cloud, MalformedError, to_uint8
from b23d.stages.geometry.text import numbers, plain, tokens_per_line, uncommented

POINT_KEYS = ("points", "xyz", "vertices", "pos", "pc", "cloud")
COLOR_KEYS = ("colors", "rgb", "vertex_colors")


def read_pcd(data: bytes) -> Cloud:
    """A PCD file of the Point Cloud Library; `rgb` is its packed colour, as integer or as the bits of a float.

    Raises MalformedError, also for `DATA binary_compressed`.
    """
    start = re.search(rb"(?m)^DATA[ \t]+(\w+)[ \t]*\r?\n", data)
    if start is None:
        raise MalformedError(
            "header: expected a PCD header that ends with `DATA ascii` or `DATA binary`, got none; is it a PCD file?"
        )
    header = {
        words[0]: words[1:] for line in data[: start.start()].decode("latin-1").splitlines() if (words := line.split())
    }
    fields = header.get("FIELDS", header.get("COLUMNS", []))
    try:
        counts = [int(n) for n in header.get("COUNT", ["1"] * len(fields))]
        sizes = [int(n) for n in header["SIZE"]]
        kinds = [{"F": "f", "U": "u", "I": "i"}[kind] for kind in header["TYPE"]]
        rows = int(header["POINTS"][0]) if "POINTS" in header else int(header["WIDTH"][0]) * int(header["HEIGHT"][0])
        types = [np.dtype(f"<{kind}{size}") for kind, size in zip(kinds, sizes, strict=True)]
        layout = np.dtype([(f"{i}", kind, (count,)) for i, (kind, count) in enumerate(zip(types, counts, strict=True))])
        x, y, z = (fields.index(axis) for axis in "xyz")
        if len(fields) != len(types) or rows < 0 or min(counts) < 1:
            raise ValueError("counts differ")
    except (KeyError, ValueError, IndexError, TypeError) as error:
        raise MalformedError(
            "header: expected FIELDS with x y z and as many SIZE, TYPE and COUNT, got others; convert it again"
        ) from error

    encoding = start.group(1).lower()
    body = data[start.end() :]
    if encoding == b"ascii":
        values = numbers(uncommented(plain(body)), "points")
        width = sum(counts)
        if len(values) != rows * width:
            raise MalformedError(
                f"points: expected {rows} rows of {width} numbers, got {len(values)} numbers; copy the file again"
            )
        table = values.reshape(rows, width)
        first = np.cumsum(counts) - counts
        columns = [
            table[:, c].astype(kind) if kind.kind != "f" else table[:, c] for c, kind in zip(first, types, strict=True)
        ]
    elif encoding == b"binary":
        if len(body) < rows * layout.itemsize:
            raise MalformedError(
                f"points: expected {rows * layout.itemsize} bytes, got {len(body)}; copy the file again"
            )
        record = np.frombuffer(body, layout, count=rows)
        columns = [record[name][:, 0] for name in layout.names or ()]
    else:
        raise MalformedError(
            f"data: expected ascii or binary, got {encoding.decode()}; "
            "convert it (pcl_convert_pcd_ascii_binary, Open3D)"
        )
    points = np.stack([columns[axis] for axis in (x, y, z)], axis=1).astype(np.float64)
    packed = next((fields.index(name) for name in ("rgb", "rgba") if name in fields), None)
    return Cloud(points, None if packed is None else _unpack(columns[packed]))


def read_xyz(data: bytes) -> Cloud:
    """Lines of `x y z …`, blanks or commas between; `r g b` (0 … 255) in the last 3 of 6 or more columns, else those
    are ignored.

    Lines that begin with a letter or `#`, and a first line that holds only the count, are skipped. Raises
    MalformedError.
    """
    text = re.sub(
        rb"(?mi)^(?!nan|inf)[a-z/][^\n]*\n", b"", uncommented(plain(data).replace(b",", b" ").replace(b";", b" "))
    )
    text = re.sub(rb"\A\s*\d+ *\n", b"", text)
    text = re.sub(rb"\n\s*\n", b"\n", text).lstrip()
    widths = tokens_per_line(text)
    values = numbers(text, "points")
    if not len(widths) or (widths != widths[0]).any() or widths[0] < 3 or len(values) != widths.sum():
        raise MalformedError(
            "points: expected lines of x y z (and more columns, equally many in each line), got others; write it again"
        )
    table = values.reshape(len(widths), int(widths[0]))
    last = table[:, -3:]
    is_color = (
        table.shape[1] >= 6 and bool(((last >= 0) & (last <= 255) & (last == np.floor(last))).all()) and last.max() > 1
    )
    return Cloud(table[:, :3], to_uint8(last) if is_color else None)


def read_npz(data: bytes) -> Cloud:
    """An NPZ file: the array named points, xyz, vertices, pos, pc or cloud, else its only (n, 3 or more) array of
    numbers that is not called after colours, normals or faces.

    Colours (n, 3) are read from colors, rgb or vertex_colors. Pickled objects are never loaded. Raises MalformedError.
    """
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
    except (OSError, ValueError, EOFError, KeyError, AttributeError, zipfile.BadZipFile) as error:
        raise MalformedError(
            "file: expected an npz archive of plain arrays, got something else; write it with numpy.savez"
        ) from error
    others = (*COLOR_KEYS, "normals", "faces")
    usable = {
        name: a
        for name, a in arrays.items()
        if a.ndim == 2 and a.shape[1] >= 3 and a.dtype.kind in "fiu" and name not in others
    }
    name = next((key for key in POINT_KEYS if key in usable), next(iter(usable)) if len(usable) == 1 else None)
    if name is None:
        got = ", ".join(f"{key} {a.shape}" for key, a in arrays.items()) or "none"
        raise MalformedError(
            f"arrays: expected one called `points` of shape (n, 3), got {got}; write it with numpy.savez(points=…)"
        )
    colors = next(
        (arrays[key] for key in COLOR_KEYS if key in arrays and arrays[key].shape == (len(usable[name]), 3)), None
    )
    return Cloud(usable[name][:, :3].astype(np.float64), None if colors is None else to_uint8(colors))


def _unpack(packed: np.ndarray) -> np.ndarray:
    """PCL's packed colour (…, 0xAARRGGBB) as (n, 3) uint8."""
    bits = (
        packed.astype(np.float32).view(np.uint32)
        if packed.dtype.kind == "f"
        else packed.astype(np.int64).astype(np.uint32)
    )
    return np.stack([(bits >> 16) & 255, (bits >> 8) & 255, bits & 255], axis=1).astype(np.uint8)
