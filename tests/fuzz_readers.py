"""Damaged files for every reader: each is read, or refused with a ValueError that names shape and file, in bounded time
and memory.

`python -m tests.fuzz_readers 3000` tries as many; the suite tries a sample.
"""

from __future__ import annotations

import sys
import time
import tracemalloc
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from b23d.stages.geometry.loading import load
from b23d.stages.geometry.surface import Surface
from tests import test_text_formats
from tests.made_gltf import TABLE, Gltf
from tests.test_bad_files import FORMATS
from tests.test_loading import COLORS, POINTS, npz
from tests.test_polygons import WRITERS, U, lifted

SECONDS = 10.0
"""CPU time that no input may take."""
TIMES, BYTES = 10, 200 << 20
"""Memory that no input may take: so many times its size, and these bytes."""
NUMBERS = [b"0", b"-1", b"4294967295", b"99999999999", b"1e308", b"nan", b"0,5", b"2.5", b""]


@dataclass
class Outcome:
    tried: int = 0
    read: int = 0
    slowest: float = 0.0
    """CPU seconds."""
    largest: int = 0
    """Bytes of memory at once."""
    faults: list[str] = field(default_factory=list)
    kinds: Counter[str] = field(default_factory=Counter)


def seeds() -> list[tuple[str, bytes]]:
    """Small files that are right, in every format and kind."""
    files = [(name, make()) for name, make in FORMATS.items()]
    files += [(name, text.encode()) for name, text in test_text_formats.texts().items()]
    files += [(name, write(lifted(U, np.eye(3)), list(range(8)))) for name, write in WRITERS.items()]
    document = Gltf()
    document.mesh(attributes={"COLOR_0": document.accessor(TABLE, sparse="zeros")}, mode=6)
    document.add("nodes", {"mesh": 0, "scale": [1, 2, 3]})
    files += [("m.glb", document.glb()), ("m.gltf", document.gltf())]
    compressed = b"DATA binary_compressed\n" + (8).to_bytes(4, "little") + (48).to_bytes(4, "little")
    head = b"FIELDS x y z\nSIZE 4 4 4\nTYPE f f f\nCOUNT 1 1 1\nWIDTH 4\nHEIGHT 1\nPOINTS 4\n"
    files.append(("lzf.pcd", head + compressed + b"\x03\0\0\x80?\xe0\x23\x03"))
    return [*files, ("c.npz", npz(points=POINTS, colors=COLORS, faces=np.zeros((2, 3))))]


def damaged(data: bytes, rng: np.random.Generator) -> bytes:
    """The bytes with some cut, flipped, repeated or put in, or a number made another."""
    made = bytearray(data)
    for _ in range(rng.integers(1, 5)):
        at, other = (int(i) for i in rng.integers(0, len(made) + 1, 2))
        what = rng.integers(0, 6)
        if what == 0:
            del made[at:]
        elif what == 1 and at < len(made):
            made[at] ^= int(rng.integers(1, 256))
        elif what == 2:
            made[at:at] = made[min(at, other) : max(at, other)]
        elif what == 3:
            made[at:at] = rng.bytes(int(rng.integers(1, 9)))
        elif what == 4:
            made[at : at + 4] = bytes([255] * 4)
        else:
            words = bytes(made).split(b" ")
            words[int(rng.integers(len(words)))] = NUMBERS[int(rng.integers(len(NUMBERS)))]
            made = bytearray(b" ".join(words))
    return bytes(made)


def fuzz(count: int, seed: int = 0) -> Outcome:
    """Try `count` damaged files, format by format in turn."""
    rng, whole, outcome = np.random.default_rng(seed), seeds(), Outcome()
    for i in range(count):
        name, data = whole[i % len(whole)]
        try_one(name, damaged(data, rng), outcome)
    return outcome


def try_one(name: str, data: bytes, outcome: Outcome) -> None:
    """Read one file and note what came of it."""
    tracemalloc.start()
    begin = time.process_time()
    try:
        read = load("class/shape", {name: data}, name)
        outcome.read += 1
        if (
            isinstance(read, Surface)
            and len(read.faces)
            and not 0 <= read.faces.min() <= read.faces.max() < len(read.vertices)
        ):
            outcome.faults.append(f"{name}: faces beyond the vertices")
    except ValueError as error:
        told = str(error)
        if not told.startswith("class/shape: ") or name not in told or "; " not in told:
            outcome.faults.append(f"{name}: {told[:200]}")
        if "does not understand" in told:
            outcome.kinds[told[:90]] += 1
    except Exception as error:  # whatever it is, it is a fault
        outcome.faults.append(f"{name}: {type(error).__name__}: {error}")
    took, memory = time.process_time() - begin, tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    outcome.tried += 1
    outcome.slowest, outcome.largest = max(outcome.slowest, took), max(outcome.largest, memory)
    if took > SECONDS or memory > TIMES * len(data) + BYTES:
        outcome.faults.append(f"{name}: {took:.1f} s, {memory >> 20} MB for {len(data)} bytes")


if __name__ == "__main__":
    result = fuzz(int(sys.argv[1]) if len(sys.argv) > 1 else 2000)
    sys.stdout.write(
        f"{result.tried} tried, {result.read} read, {len(result.faults)} faults; at most {result.slowest:.2f} s of CPU "
        f"and {result.largest >> 20} MB\n" + "".join(f"{fault}\n" for fault in result.faults[:20])
    )
    sys.stdout.write("".join(f"{times} × {kind}\n" for kind, times in result.kinds.most_common(10)))
