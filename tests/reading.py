"""Reading one file in a test."""

from __future__ import annotations

import numpy as np

from b23d.stages.geometry.cleaning import areas
from b23d.stages.geometry.loading import load
from b23d.stages.geometry.surface import Cloud, Surface


def surface(data: bytes, name: str, files: dict[str, bytes] | None = None) -> Surface:
    loaded = load("class/shape", {name: data, **(files or {})}, name)
    assert isinstance(loaded, Surface)
    return loaded


def cloud(data: bytes, name: str) -> Cloud:
    loaded = load("class/shape", {name: data}, name)
    assert isinstance(loaded, Cloud)
    return loaded


def area(read: Surface) -> float:
    return float(areas(read.vertices, read.faces).sum())


def box(read: Surface | Cloud) -> list[float]:
    """The extent along x, y and z."""
    points = read.vertices if isinstance(read, Surface) else read.points
    return [round(float(side), 6) for side in np.ptp(points, axis=0)]
