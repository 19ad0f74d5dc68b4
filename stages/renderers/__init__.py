"""Renderers: which face each pixel of each view sees, and how far away. Shading is the same for all (`shading.py`).

A renderer is one function with the signature of `Rasterize`. What it must keep to: a pixel sees what the ray through
its centre hits first; both sides of a face count; no anti-aliasing, so that every pixel has one face and one depth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Literal

import numpy as np

RendererName = Literal["embree", "pyrender"]
NEEDS = {
    "embree": "embreex (pip)",
    "pyrender": "pyrender (pip) and a GPU driver or Mesa with EGL (Debian: libegl1 libgl1-mesa-dri)",
}


@dataclass(frozen=True)
class Raster:
    """What every pixel sees."""

    face_ids: np.ndarray
    """(view, row, column) int32; -1 = background."""
    depth: np.ndarray
    """(view, row, column) float32, camera z in the unit frame; 0 = background."""


Rasterize = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, int], Raster]
"""`(vertices (v, 3), faces (f, 3), world_to_camera (view, 4, 4), intrinsics (3, 3), resolution) → Raster`."""


def renderer(name: RendererName) -> Rasterize:
    """The renderer of that name, imported only now: neither embree nor OpenGL is needed before.

    Raises RuntimeError where a library that it needs cannot be loaded.
    """
    try:
        rasterize: Rasterize = import_module(f"b23d.stages.renderers.{name}").rasterize
    except (ImportError, AttributeError, OSError) as error:  # PyOpenGL without libEGL raises any of them
        raise RuntimeError(
            f"renderer {name}: expected its library to load, got {type(error).__name__}: {error}; "
            f"install {NEEDS[name]}, or choose the other renderer"
        ) from error
    return rasterize
