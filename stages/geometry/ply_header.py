"""The header of a PLY: which elements follow, with which properties, and where."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from b23d.stages.geometry.surface import MalformedError

TYPES = {
    **{"char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1"},
    **{"short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2"},
    **{"int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "int64": "i8", "uint64": "u8"},
    **{"float": "f4", "float32": "f4", "double": "f8", "float64": "f8"},
}
ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass
class Property:
    name: str
    type: np.dtype
    count: np.dtype | None = None
    """Type of the length of a list; None for a single value."""


@dataclass
class Element:
    name: str
    rows: int
    properties: list[Property] = field(default_factory=list)


@dataclass
class PlyHeader:
    elements: list[Element]
    ascii: bool
    end: int
    """Where the body begins, bytes."""
    lines: int
    """How many lines the header has."""


def read_header(data: bytes) -> PlyHeader:
    """The header of a PLY, names in lower case. Raises MalformedError, with the line."""
    classic = re.match(rb"[^\r\n]*\r(?!\n)", data) is not None  # lines that end with a carriage return alone
    end = re.search(rb"[\r\n]end_header[ \t]*" + (rb"(?:\r|\Z)" if classic else rb"(?:\r?\n|\Z)"), data)
    head = data[: end.start()].decode("latin-1").splitlines() if end else []
    if end is None or not head or head[0].strip().lower() != "ply":
        raise MalformedError(
            "header: expected `ply` … `end_header`, got something else; is it a PLY file, and complete?"
        )
    order = None
    elements: list[Element] = []
    for number, line in enumerate(head[1:], start=2):
        words = line.split()
        try:
            if words[:1] == ["format"]:
                order = ORDERS[words[1]]
            elif words[:1] == ["element"]:
                elements.append(Element(words[1].lower(), int(words[2])))
            elif words[:2] == ["property", "list"]:
                count, kind = (_type(word, order) for word in words[2:4])
                elements[-1].properties.append(Property(words[4].lower(), kind, count))
            elif words[:1] == ["property"]:
                elements[-1].properties.append(Property(words[2].lower(), _type(words[1], order)))
        except (IndexError, KeyError, ValueError) as error:
            raise MalformedError(
                f"line {number}: expected a PLY header line, got {line[:60]!r}; export the file again"
            ) from error
    if order is None:
        raise MalformedError("header: expected a format line, got none; export the file again")
    for names in ([e.name for e in elements], *([p.name for p in e.properties] for e in elements)):
        if twice := next((name for name in names if names.count(name) > 1), None):
            raise MalformedError(f"header: expected each name once, got {twice} twice; export the file again")
    return PlyHeader(elements, order == "=", end.end(), len(head) + 1)


def _type(name: str, order: str | None) -> np.dtype:
    return np.dtype((order or "=") + TYPES[name.lower()])
