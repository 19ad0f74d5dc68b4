"""What the renderer gives (Views) and what the encoder makes of it (ViewTokens).

Camera convention, here and nowhere else (OpenCV's): camera looks along +z, x to the right, y down. A point p of the
unit frame has camera coordinates `c = world_to_camera[:3, :3] @ p + world_to_camera[:3, 3]`, depth `c.z` > 0, and pixel
`(x, y) = ((K @ c) / c.z)[:2]` with the intrinsics K; the centre of the upper left pixel is (0.5, 0.5), so pixel
(column j, row i) covers [j, j+1) × [i, i+1).
"""

from __future__ import annotations

from typing import Annotated, Any

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
    """Tokens of those patches of every view that show the shape (or of all of them), view by view and row by row.

    The patch grid covers the whole image: patch (i, j) is centred at `((j + .5) * columns / grid, (i + .5) * rows /
    grid)` pixels of the view.
    """

    tokens: Annotated[np.ndarray, ArraySpec("m channel", "float16")]
    rows: Annotated[np.ndarray, ArraySpec("view i j", "int32", unit="row of tokens", sharded=True)]
    """The token that stands for each patch: its own, or, where it has none, that of its view's nearest patch."""
    kept: Annotated[np.ndarray, ArraySpec("view i j", "bool", sharded=True)]
    """Whether the patch has a token of its own."""
    class_tokens: Annotated[np.ndarray, ArraySpec("view channel", "float16")] | None = None
    """None for encoders that have none (SAM, EfficientNet)."""
    encoder: str
    weights: str
    """sha256 of the weights."""

    def grid(self, views: Any = slice(None)) -> np.ndarray:
        """Tokens of some views (default: all) as a full grid, float16 (view, i, j, channel): a patch without its own
        has its view's nearest."""
        grid: np.ndarray = self.tokens[self.rows[views]]
        return grid
