"""Looking at one artifact: its arrays, ranges and provenance, and its export to a file."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import RenderableType
from rich.table import Table

from b23d.pipeline.config import feeding
from b23d.pipeline.run import Run
from b23d.schemas.artifact import Artifact

Exporter = Callable[[Run, str, str, int | None, Artifact, Path], None]


def artifact_tables(run: Run, shape: str, stage: str, draw: int | None = None) -> list[RenderableType]:
    """Tables of an artifact's arrays, its other fields, and its provenance.

    Raises KeyError (no such shape or stage), ArtifactNotFoundError (not made yet), CorruptArtifactError.
    """
    node = run.node(shape, stage, draw)
    head = run.store.head(node.stage, node.address)
    artifact = run.artifact(shape, stage, draw)
    specs = type(artifact).array_specs()
    title = f"{node.stage} of {shape} ({head.schema})"
    arrays = Table("array", "shape", "dtype", "range", "unit", "stored", title=title, title_justify="left")
    for name, array in artifact.present_arrays().items():
        size = f"{head.arrays[name].stored_bytes / 1e6:.2f} MB"
        arrays.add_row(
            name, " × ".join(map(str, array.shape)), array.dtype.name, value_range(array), specs[name].unit, size
        )
    values = Table("field", "value", show_header=False, title="fields", title_justify="left")
    for name, value in head.values.items():
        values.add_row(name, _short(value))
    provenance = Table("key", "value", show_header=False, title="provenance", title_justify="left")
    for name, value in head.provenance.items():
        provenance.add_row(name, _short(value, 400))
    return [arrays, values, provenance]


def thumbnail(run: Run, shape: str, stage: str, draw: int | None, width: int) -> RenderableType | None:
    """A picture of an artifact for a terminal `width` characters wide, by the first plugged-in painter that knows its
    kind."""
    artifact = run.artifact(shape, stage, draw)
    painted = (plugin.load()(run, shape, artifact, width) for plugin in entry_points(group="b23d.thumbnails"))
    return next((picture for picture in painted if picture is not None), None)


def value_range(array: np.ndarray) -> str:
    """Least, greatest, and how much is not finite, in a few characters."""
    if array.size == 0:
        return "empty"
    if array.dtype == bool:
        return f"{int(array.sum())} of {array.size} true"
    finite = array[np.isfinite(array)].astype(float) if array.dtype.kind == "f" else array
    text = f"{finite.min():.4g} … {finite.max():.4g}" if finite.size else "none finite"
    lost = array.size - finite.size
    return f"{text}, {lost} not finite" if lost else text


def export_artifact(run: Run, shape: str, stage: str, draw: int | None, path: Path) -> None:
    """Write an artifact as `.npz` (every array and field), or in a format that a plugged-in exporter knows.

    Raises ValueError for a suffix nobody knows.
    """
    artifact = run.artifact(shape, stage, draw)
    suffix = path.suffix.lower()
    exporters: dict[str, Exporter] = {
        f".{plugin.name}": plugin.load() for plugin in entry_points(group="b23d.exporters")
    }
    if suffix == ".npz":
        fields: dict[str, Any] = {**artifact.present_arrays(), "fields": np.array(json.dumps(artifact.plain_fields()))}
        np.savez_compressed(path, **fields)
    elif suffix in exporters:
        exporters[suffix](run, shape, feeding(run.config.file, stage), draw, artifact, path)
    else:
        known = ", ".join([".npz", *sorted(exporters)])
        raise ValueError(f"export: expected one of {known}, got {path.suffix or path.name!r}; change the file's name")


def _short(value: Any, length: int = 160) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= length else f"{text[:length]}… ({len(text)} characters)"
