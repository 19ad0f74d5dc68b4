"""What the renderer gives (Views) and what the encoder makes of it (ViewTokens).

Camera convention, here and nowhere else (OpenCV's): camera looks along +z, x to the right, y down. A point p of the
unit frame has camera coordinates `c = world_to_camera[:3, :3] @ p + world_to_camera[:3, 3]`, depth `c.z` > 0, and pixel
`(x, y) = ((K @ c) / c.z)[:2]` with the intrinsics K; the centre of the upper left pixel is (0.5, 0.5), so pixel
(column j, row i) covers [j, j+1) × [i, i+1).
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from b23d.schemas.artifact import ArraySpec, Artifact


class Views(Artifact):
    """A shape seen from all sides. Frames: `schemas/views.py`'s camera convention; lengths in the unit frame."""

    images: Annotated[np.ndarray, ArraySpec("view row column 3", "uint8", unit="sRGB, white background", sharded=True)]
    depth: Annotated[np.ndarray, ArraySpec("view row column", "float32", unit="camera z; 0 = background", sharded=True)]
    face_ids: Annotated[
        np.ndarray, ArraySpec("view row column", "int32", unit="face or cloud point; -1 = background", sharded=True)
    ]
    world_to_camera: Annotated[np.ndarray, ArraySpec("view 4 4", "float64")]
    intrinsics: Annotated[np.ndarray, ArraySpec("3 3", "float64", unit="pixel")]
    renderer: str
    distance: float
    """Camera's distance from the origin, unit frame."""


class ViewTokens(Artifact):
    """Patch tokens of every view. The grid covers the whole image: token (i, j) is centred at
    `((j + .5) * columns / grid, (i + .5) * rows / grid)` pixels of the view."""

    tokens: Annotated[np.ndarray, ArraySpec("view i j channel", "float16", sharded=True)]
    class_tokens: Annotated[np.ndarray, ArraySpec("view channel", "float16")] | None = None
    """None for encoders that have none (SAM, EfficientNet)."""
    encoder: str
    weights: str
    """sha256 of the weights."""
