"""Flipped bits, and who notices."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from b23d.pipeline.errors import CorruptArtifactError
from b23d.pipeline.store import HEAD, Store
from b23d.schemas.artifact import Artifact


def flips(files: list[Path], count: int, rng: random.Random) -> Iterator[tuple[Path, bytes]]:
    """`count` times one file's bytes with one bit flipped, every file in turn."""
    for i in range(count):
        path = files[i % len(files)]
        data = bytearray(path.read_bytes())
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
        yield path, bytes(data)


def served_wrongly(store: Store, stage: str, address: str, schema: type[Artifact], flipped: Path) -> bool:
    """Whether reading gives anything without complaint although a file it reads is damaged. An array's own `zarr.json`
    is read by zarr alone: what the head says decides."""
    try:
        artifact = store.read(stage, address, schema)
        for array in artifact.present_arrays().values():
            np.asarray(array)
    except CorruptArtifactError:
        return False
    return not (flipped.name == HEAD and flipped.parent != Path(store.path(stage, address)))


def unnoticed_by_verify(store: Store, stage: str, address: str) -> bool:
    return store.damage(stage, address) == []
