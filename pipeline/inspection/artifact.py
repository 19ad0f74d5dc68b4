"""Looking at one artifact: its arrays, ranges and provenance, and its export to a file."""

from __future__ import annotations

import glob
import json
from collections.abc import Callable
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rich.console import RenderableType
from rich.markup import escape
from rich.table import Table

from b23d.pipeline.dataset import is_export
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import feeding
from b23d.schemas.artifact import Artifact

FrameName = Literal["file", "unit"]
"""Of exported geometry: the shape's own file's coordinates, or the unit frame."""
Exporter = Callable[[Run, str, str, int | None, Artifact, Path, FrameName], None]
MARK = "b23d export"
"""Stands in every exported file that could be taken for a shape."""


def artifact_tables(run: Run, shape: str, stage: str, draw: int | None = None) -> list[RenderableType]:
    """Tables of an artifact's arrays, its other fields, and its provenance.

    Raises KeyError (no such shape or stage), ArtifactNotFoundError (not made yet), CorruptArtifactError.
    """
    node = run.node(shape, stage, draw)
    head = run.store.head(node.stage, node.address)
    artifact = run.artifact(shape, stage, draw)
    specs = type(artifact).array_specs()
    title = escape(f"{node.stage} of {shape} ({head.schema})")
    arrays = Table("array", "shape", "dtype", "range", "unit", "stored", title=title, title_justify="left")
    for name, array in artifact.present_arrays().items():
        size = f"{head.arrays[name].stored_bytes / 1e6:.2f} MB"
        arrays.add_row(
            name, " × ".join(map(str, array.shape)), array.dtype.name, value_range(array), specs[name].unit, size
        )
    values = Table("field", "value", show_header=False, title="fields", title_justify="left")
    for name, value in head.values.items():
        values.add_row(escape(name), escape(_short(value)))
    provenance = Table("key", "value", show_header=False, title="provenance", title_justify="left")
    for name, value in head.provenance.items():
        provenance.add_row(escape(name), escape(_short(value, 400)))
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


def export_artifact(
    run: Run, shape: str, stage: str, draw: int | None, path: Path, frame: FrameName = "file"
) -> list[Path]:
    """Write an artifact in the format of the path's suffix, by the plugged-in exporter that knows it; its folder is
    made. Returns what was written: the file, and what lies beside it (an OBJ's material and texture).

    In a folder where the run's data set looks for shapes, the file gets `.b23d` into its name, by which data sets pass
    it over. Raises ValueError for a suffix nobody knows.
    """
    exporters: dict[str, Exporter] = {
        f".{plugin.name}": plugin.load() for plugin in entry_points(group="b23d.exporters")
    }
    if path.suffix.lower() not in exporters:
        known = ", ".join(sorted(exporters))
        raise ValueError(f"export: expected one of {known}, got {path.suffix or path.name!r}; change the file's name")
    artifact = run.artifact(shape, stage, draw)
    path = passed_over(path, run)
    path.parent.mkdir(parents=True, exist_ok=True)
    before = _times(path)
    exporters[path.suffix.lower()](run, shape, feeding(run.config.file, stage), draw, artifact, path, frame)
    after = _times(path)
    beside = sorted(other for other, at in after.items() if other != path and before.get(other) != at)
    return [path, *beside]


def passed_over(path: Path, run: Run) -> Path:
    """The path; with `.b23d` before its suffix where the run's data set would take a file of that name for a shape."""
    if run.config.dataset.covers(path) and not is_export(path.name):
        return path.with_name(f"{path.stem}.b23d{path.suffix}")
    return path


def _times(path: Path) -> dict[Path, int]:
    """Files that go by the path's stem, and when they were changed."""
    return {
        other: other.stat().st_mtime_ns for other in path.parent.glob(f"{glob.escape(path.stem)}*") if other.is_file()
    }


def _short(value: Any, length: int = 160) -> str:
    text = value if isinstance(value, str) else json.dumps(value)
    return text if len(text) <= length else f"{text[:length]}… ({len(text)} characters)"
