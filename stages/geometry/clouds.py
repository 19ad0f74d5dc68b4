"""Point clouds as rows of text (XYZ) or arrays (NPZ). Their points keep the file's order, since keypoints count
them."""

from __future__ import annotations

import io
import re
import zipfile
from typing import Any

import numpy as np

from b23d.stages.geometry.surface import Cloud, MalformedError, to_uint8
from b23d.stages.geometry.text import numbers, plain, tokens_per_line, uncommented, without_commas

POINT_KEYS = ("points", "xyz", "vertices", "pos", "pc", "cloud")
COLOR_KEYS = ("colors", "rgb", "vertex_colors")
WIDEST = 16
"""An array of more columns is no list of points: it may be one that is transposed."""
MOST = 200 << 20
"""Bytes that an array of a compressed file may have, at least."""


def read_xyz(data: bytes) -> Cloud:
    """Lines of `x y z …`; blanks, tabs, commas or semicolons between; `r g b` (0 … 255) in the last 3 of 6 or more
    columns, else those are ignored.

    Lines at the start that begin with a letter, comments behind `#` or `//`, and a first line that holds only the count
    are passed over. Raises MalformedError.
    """
    text = uncommented(plain(data).replace(b";", b" "))
    text = re.sub(rb"(?m)^//[^\n]*", b"", text)
    head = re.match(rb"(?i)(?:(?!nan|inf)\"?[a-z_][^\n]*\n|\s*\n)*", text)
    skipped = 0 if head is None else head.end()
    count = re.match(rb"(\d+) *\n\s*(?=\S)", text[skipped:])
    skipped += 0 if count is None else count.end()
    first = text.count(b"\n", 0, skipped) + 1
    lines = np.arange(first, first + text.count(b"\n", skipped))
    text = without_commas(text[skipped:], "points", lines)
    widths = tokens_per_line(text)
    values = numbers(text, "points", lines)
    lines, widths = lines[widths > 0], widths[widths > 0]
    if (
        not len(widths)
        or (wrong := np.flatnonzero((widths != widths[0]) | (widths < 3))).size
        or len(values) != widths.sum()
    ):
        got = f"line {lines[wrong[0]]} of {widths[wrong[0]]}" if len(widths) and wrong.size else "others"
        raise MalformedError(
            f"points: expected lines of x y z (and more columns, equally many in each line), got {got}; write it again"
        )
    if count is not None and int(count[1]) != len(widths):
        raise MalformedError(
            f"points: expected {int(count[1])}, as the first line says, got {len(widths)}; copy it again"
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
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()}
            headers = {name: _header(archive, entry) for name, entry in members.items()}
            usable = [
                name
                for name, (shape, kind, _) in headers.items()
                if len(shape) == 2
                and shape[1] >= 3
                and kind.kind in "fiu"
                and name not in (*COLOR_KEYS, "normals", "faces")
            ]
            name = next((key for key in POINT_KEYS if key in usable), usable[0] if len(usable) == 1 else None)
            if name is None:
                raise _no_points(headers)
            points = _array(archive, members[name], *headers[name], len(data), name)
            shapes = {key: headers[key][0] for key in COLOR_KEYS if key in headers}
            key = next((key for key, shape in shapes.items() if shape == (len(points), 3)), None)
            colors = None if key is None else _array(archive, members[key], *headers[key], len(data), key)
    except MalformedError:
        raise
    except Exception as error:  # zipfile, zlib and numpy each have their own
        raise MalformedError(
            "file: expected an npz archive of plain arrays, got something else; write it with numpy.savez"
        ) from error
    if len(points) <= WIDEST < points.shape[1] or len(points) == 3 < points.shape[1]:
        raise MalformedError(
            f"{name}: expected an array (n, 3), got {points.shape}, which looks transposed; save {name}.T"
        )
    if points.shape[1] > WIDEST:
        raise _no_points(headers)
    return Cloud(
        points[:, :3].astype(np.float64),
        None if colors is None or colors.dtype.kind not in "fiu" else to_uint8(colors),
    )


def _no_points(headers: dict[str, tuple[tuple[int, ...], np.dtype, bool]]) -> MalformedError:
    got = ", ".join(f"{key} {shape} {kind}" for key, (shape, kind, _) in headers.items()) or "none"
    return MalformedError(
        f"arrays: expected one called `points` of shape (n, 3), got {got[:500]}; write it with numpy.savez(points=…)"
    )


def _header(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> tuple[tuple[int, ...], np.dtype, bool]:
    """Shape, type and whether in Fortran's order, of an array that is not read. Raises MalformedError for objects."""
    with archive.open(entry) as file:
        version = np.lib.format.read_magic(file)
        read: Any = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, kind = read(file)
    if kind.hasobject:
        raise MalformedError(
            f"{entry.filename}: expected an npz archive of plain arrays, got pickled objects; write it with numpy.savez"
        )
    return shape, kind, fortran


def _array(
    archive: zipfile.ZipFile,
    entry: zipfile.ZipInfo,
    shape: tuple[int, ...],
    kind: np.dtype,
    fortran: bool,
    size: int,
    name: str,
) -> np.ndarray:
    """An array of the archive. Raises MalformedError where its header promises more than the file can honestly hold."""
    promised = kind.itemsize * int(np.prod(shape, dtype=object))
    if promised > entry.file_size or entry.file_size > MOST + 4 * size:
        raise MalformedError(
            f"{name}: expected an array of {entry.file_size} bytes in a file of {size}, got one of {promised}; "
            "write it with numpy.savez"
        )
    data = archive.read(entry)[-promised:] if promised else b""
    return np.frombuffer(data, kind).reshape(shape, order="F" if fortran else "C")
