"""STL, binary and ASCII, three vertices of its own to each face. Our own reader because trimesh's believes the header's
count, and asks for another package where an ASCII file is not UTF-8."""

from __future__ import annotations

import re

import numpy as np

from b23d.schemas.wording import counted
from b23d.stages.geometry.encoding import unmarked
from b23d.stages.geometry.surface import MalformedError, Surface
from b23d.stages.geometry.text import numbers, plain, tokens_per_line, without_commas

HEADER, RECORD = 84, 50
"""Bytes before the triangles of a binary file, and of each."""
VERTEX = re.compile(rb"\bvertex\s+(\S+ +\S+ +\S+)")
NAMES = re.compile(rb"(?m)^(?:end)?solid\b(?:(?!\bfacet\s+normal\b)[^\n])*")


def read_stl(data: bytes) -> Surface:
    """The triangles of an STL in the file's order; of several solids, all. Colours (in no standard) are not read.

    Raises MalformedError. A wrong count in a binary header is mended where the file's length leaves no doubt; that, and
    a text without its last line, is counted in `problems`.
    """
    text = unmarked(data)
    looks_like_text = text[:512].lstrip()[:5].lower() == b"solid" and b"\0" not in text[:HEADER]
    if looks_like_text and len(data) != HEADER + RECORD * _count(data) and b"facet" in text[:4096].lower():
        return _ascii(plain(text))
    return _binary(data)


def _count(data: bytes) -> int:
    return int.from_bytes(data[HEADER - 4 : HEADER], "little")


def _binary(data: bytes) -> Surface:
    announced, (held, beyond) = _count(data), divmod(len(data) - HEADER, RECORD)
    problems = {}
    if len(data) < HEADER:
        raise MalformedError(
            f"header: expected an ASCII STL or {HEADER} bytes of a binary one, "
            f"got {counted(len(data), 'byte')}; export it again"
        )
    if announced > held and announced != 2**32 - 1:
        raise MalformedError(
            f"header: expected {counted(announced, 'triangle')}, as it says, "
            f"got a file that holds {held}; copy or export it again"
        )
    if announced in (0, 2**32 - 1) or (announced < held and not beyond):  # writers that do not know it beforehand
        problems["triangle_count"] = int(announced != held)
        announced = held
    elif announced < held:
        raise MalformedError(
            f"header: expected {counted(announced, 'triangle')}, as it says, "
            f"got a file that holds {held}; export it again"
        )
    if beyond:
        problems["trailing_bytes"] = beyond
    if not announced:
        raise MalformedError("data: expected triangles, got none; restore the mesh or remove the shape")
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    vertices = np.frombuffer(data, record, count=announced, offset=HEADER)["corners"].reshape(-1, 3)
    return _surface(vertices.astype(np.float64), {what: times for what, times in problems.items() if times})


def _ascii(text: bytes) -> Surface:
    text = text.lower()
    ended = text.find(b"endsolid", text.rfind(b"endfacet")) >= 0  # else the file may have been cut between two facets
    text = NAMES.sub(b"", text)
    if (first := text.find(b"vertex")) < 0:
        raise MalformedError("data: expected facets with vertices, got none; restore the mesh or remove the shape")
    found = list(VERTEX.finditer(text, first))
    block = b"\n".join(match[1] for match in found) + b"\n"
    at = np.array([match.start() for match in found])
    ends = np.flatnonzero(np.frombuffer(text, np.uint8) == ord("\n"))
    lines = np.searchsorted(ends, at) + 1
    block = without_commas(block, "vertex", lines)
    values = numbers(block, "vertex", lines)
    if (wrong := np.flatnonzero(tokens_per_line(block) != 3)).size or len(values) != 3 * len(found):
        where = f"line {lines[wrong[0]]}: " if wrong.size else ""
        raise MalformedError(f"{where}vertex: expected 3 numbers, got others; export the mesh again")
    facets = [match.start() for match in re.finditer(rb"\bfacet\b", text)]
    inside = np.searchsorted(at, [*facets, len(text)])
    counts = np.diff(inside)
    if (wrong := np.flatnonzero(counts != 3)).size or inside[0] or len(found) != text.count(b"vertex"):
        facet = facets[wrong[0]] if wrong.size else 0
        got = f"{counts[wrong[0]]}" if wrong.size else "vertices without 3 numbers"
        raise MalformedError(
            f"line {np.searchsorted(ends, facet) + 1}: facet: expected 3 vertices, got {got}; copy or export it again"
        )
    return _surface(values.reshape(-1, 3), {} if ended else {"no_endsolid": 1})


def _surface(vertices: np.ndarray, problems: dict[str, int]) -> Surface:
    return Surface(vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3), problems=problems)
