"""The elements of a PLY, ASCII or binary, as arrays: what stands in the file, whatever it means.

Our own reader because trimesh refuses binary files that mix triangles and quads (Blender's), and plyfile is GPL.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from b23d.schemas.wording import counted
from b23d.stages.geometry.ply_header import Element, Property, read_header
from b23d.stages.geometry.surface import MalformedError
from b23d.stages.geometry.text import numbers, plain, tokens_per_line, uncommented, without_commas

Lists = tuple[np.ndarray, np.ndarray]
"""A list property: how many values each row has, and all values one after another."""
Table = dict[str, "np.ndarray | Lists"]
FORMATS = {"i1": "b", "u1": "B", "i2": "h", "u2": "H", "i4": "i", "u4": "I", "i8": "q", "u8": "Q", "f4": "f", "f8": "d"}
"""numpy's names of types → struct's."""


@dataclass
class Body:
    """What follows the header: bytes (uint8) of a binary file; numbers (float64) of an ASCII one, where every value
    takes one place whatever its type."""

    data: np.ndarray
    line_starts: np.ndarray | None = None
    """Of an ASCII body: where in `data` each line begins; (lines,) int64."""
    lines: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    """The file's number of each."""
    rest: int = 0
    """Where the next element begins."""
    broken: str = ""
    """What is wrong if the file turns out not to fit its header: the first row that does not begin with a line."""

    @property
    def ascii(self) -> bool:
        return self.line_starts is not None

    def size(self, kind: np.dtype) -> int:
        """Places that a value of this type takes."""
        return 1 if self.ascii else kind.itemsize

    def column(self, start: int, stride: int, kind: np.dtype, rows: int, wide: int = 1) -> np.ndarray:
        """`wide` values of each row, of rows of equal length: a view (rows, wide), no copy."""
        if self.ascii:
            return np.ndarray((rows, wide), np.float64, self.data.data, 8 * start, (8 * stride, 8))
        return np.ndarray((rows, wide), kind, self.data.data, start, (stride, kind.itemsize))

    def runs(self, starts: np.ndarray, counts: np.ndarray, kind: np.dtype) -> np.ndarray:
        """The values of runs of `counts` values that begin at `starts` (ascending), one after another."""
        taken = np.zeros(len(self.data) + 1, np.int8)
        filled = counts > 0
        taken[starts[filled]] += 1
        taken[starts[filled] + counts[filled] * self.size(kind)] -= 1
        run = self.data[np.cumsum(taken[:-1], dtype=np.int8).astype(bool)]
        return run if self.ascii else run.view(kind)

    def whole_number(self, kind: np.dtype) -> Callable[[int], int]:
        """What reads one value, which should be a whole number, at a place; -1 where it is not."""
        if self.ascii:
            values = self.data.data
            return lambda at: _whole(values[at])
        read = struct.Struct((kind.byteorder if kind.byteorder in "<>" else "=") + FORMATS[kind.str[1:]]).unpack_from
        body = self.data.data
        return lambda at: _whole(read(body, at)[0])

    def short(self, element: Element) -> MalformedError:
        return MalformedError(
            self.broken
            or f"{element.name}: expected {counted(element.rows, 'row')}, got a file that ends before; "
            "copy or export it again"
        )

    def check_lines(self, element: Element, starts: np.ndarray) -> None:
        """Remember the first row of an ASCII element that does not begin with a line."""
        if self.line_starts is None or self.broken or not len(starts):
            return
        first = int(np.searchsorted(self.line_starts, starts[0]))
        begins = self.line_starts[first : first + len(starts) + 1]
        rows = np.append(starts, self.rest)[: len(begins)]
        if (wrong := np.flatnonzero(begins != rows)).size:
            row = max(int(wrong[0]) - 1, 0)
            got = int(begins[row + 1] - begins[row]) if row + 1 < len(begins) else len(self.data) - int(begins[row])
            self.broken = (
                f"line {self.lines[first + row]}: {element.name} {row}: expected as many numbers as the header "
                f"announces, got {got}; export the file again"
            )


def _whole(value: float) -> int:
    """The number itself, as int; -1 where it is not whole, negative, or longer than any list."""
    return int(value) if 0 <= value < 2**40 and value == value // 1 else -1


def read_tables(data: bytes) -> tuple[dict[str, Table], dict[str, int]]:
    """The elements of a PLY by name, in the file's order, those without rows too; and what stands behind the last.

    The latter is counted as `trailing_lines` or `trailing_bytes`. Raises MalformedError.
    """
    header = read_header(data)
    if header.ascii:
        text = uncommented(plain(data[header.end :]))
        every = np.arange(header.lines + 1, header.lines + 1 + text.count(b"\n"))
        text = without_commas(text, "data", every)
        widths = tokens_per_line(text)
        values = numbers(text, "data", every)
        body = Body(values, (np.cumsum(widths) - widths)[widths > 0], every[widths > 0])
    else:
        body = Body(np.frombuffer(data, np.uint8)[header.end :])
    tables = {element.name: _rows(element, body) for element in header.elements}
    if body.broken and body.rest < len(body.data):
        raise MalformedError(body.broken)
    if body.line_starts is not None:
        return tables, {"trailing_lines": int((body.line_starts >= body.rest).sum())}
    return tables, {"trailing_bytes": len(body.data) - body.rest}


def _rows(element: Element, body: Body) -> Table:
    """The properties of one element; `body.rest` moves behind it. Raises MalformedError."""
    smallest = sum(body.size(prop.count or prop.type) for prop in element.properties)
    if element.rows < 0 or element.rows * smallest > len(body.data) - body.rest:
        raise body.short(element)
    if not element.rows or not smallest:
        nothing = np.zeros(0, np.int64)
        return {prop.name: nothing if prop.count is None else (nothing, nothing) for prop in element.properties}
    return _uniform(element, body) or _ragged(element, body)


def _uniform(element: Element, body: Body) -> Table | None:
    """The element, if its rows are all as long as the first: views by stride. None where they are not."""
    at = body.rest
    places: list[tuple[Property, int, int]] = []
    for prop in element.properties:
        wide = 1
        if prop.count is not None:
            if at + body.size(prop.count) > len(body.data):
                raise body.short(element)
            wide = body.whole_number(prop.count)(at)
            at += body.size(prop.count)
        places.append((prop, at, wide))
        at += wide * body.size(prop.type)
    stride, start = at - body.rest, body.rest
    if min(wide for *_, wide in places) < 0 or start + stride * element.rows > len(body.data):
        return None
    for prop, place, wide in places:
        if prop.count is not None:
            counts = body.column(place - body.size(prop.count), stride, prop.count, element.rows)
            if (counts != wide).any():
                return None
    body.rest = start + stride * element.rows
    body.check_lines(element, start + stride * np.arange(element.rows) if body.ascii else np.zeros(0))
    table: Table = {}
    for prop, place, wide in places:
        values = body.column(place, stride, prop.type, element.rows, wide)
        full = np.full(element.rows, wide, np.int64)
        table[prop.name] = values[:, 0] if prop.count is None else (full, values.reshape(-1))
    return table


def _ragged(element: Element, body: Body) -> Table:
    """The element row by row: where one begins is known only where the one before it ends."""
    starts = np.empty(element.rows, np.int64)
    lengths = {prop.name: np.empty(element.rows, np.int64) for prop in element.properties if prop.count is not None}
    steps = [
        (
            lengths.get(prop.name),
            None if prop.count is None else body.whole_number(prop.count),
            0 if prop.count is None else body.size(prop.count),
            body.size(prop.type),
        )
        for prop in element.properties
    ]
    at, last = body.rest, len(body.data)
    for row in range(element.rows):
        starts[row] = at
        for counts, read, before, size in steps:
            length = 1
            if counts is not None and read is not None:
                length = read(at) if at + before <= last else -1
                counts[row] = length
            at += before + length * size
            if length < 0 or at > last:
                body.check_lines(element, starts[: row + 1])
                raise body.short(element)
    body.rest = at
    body.check_lines(element, starts)

    table: Table = {}
    place = starts
    for prop in element.properties:
        if prop.count is None:
            table[prop.name] = body.runs(place, np.ones(element.rows, np.int64), prop.type)
            place = place + body.size(prop.type)
        else:
            counts = lengths[prop.name]
            place = place + body.size(prop.count)
            table[prop.name] = (counts, body.runs(place, counts, prop.type))
            place = place + counts * body.size(prop.type)
    return table
