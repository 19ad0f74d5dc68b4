"""LZF (Lehmann's liblzf), which PCL compresses with. Written here: its one package for Python is no longer built for
today's versions, and numcodecs does not have it."""

from __future__ import annotations

from b23d.stages.geometry.surface import MalformedError

MOST = 132
"""Bytes that one compressed byte can become, at most (three become 264, and more only where they are malformed)."""


def decompress(data: bytes, size: int) -> bytes:
    """`size` bytes out of LZF. Raises MalformedError where they are not that many."""
    if size > MOST * len(data):
        raise MalformedError(f"LZF: expected at most {MOST * len(data)} bytes, got {size} announced; copy it again")
    made = bytearray()
    at, last = 0, len(data)
    while at < last and len(made) <= size:
        control = data[at]
        at += 1
        if control < 32:  # a run of literal bytes
            made += data[at : at + control + 1]
            at += control + 1
            continue
        length = (control >> 5) + 2
        if length == 9:
            if at >= last:
                break
            length += data[at]
            at += 1
        if at >= last:
            break
        start = len(made) - ((control & 31) << 8) - data[at] - 1
        at += 1
        if start < 0:
            raise MalformedError("LZF: expected references to what came before, got one beyond; copy it again")
        repeated = made[start : start + length]  # what it reaches may be shorter than the length: then it goes round
        made += (repeated * (length // len(repeated) + 1))[:length]
    if len(made) != size:
        raise MalformedError(f"LZF: expected {size} bytes, got {len(made)}; copy the file again")
    return bytes(made)
