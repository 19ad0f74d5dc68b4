"""Shapes as they come (Source), and as we use them (NormalizedShape).

Frames: *source frame* is the file's own, in the data set's units; which of its axes points up, `up` says. *Unit frame*
is the source frame rotated so that +y is up (`schemas/up_axis.py`), turned about that axis if so asked, and moved and
scaled so that the shape's bounding box is centred at the origin and its longest side is 1: `unit = (rotation @ source -
center) / scale`.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from b23d.schemas.artifact import ArraySpec, Artifact
from b23d.schemas.up_axis import UpAxis, to_y_up


class Source(Artifact):
    """The bytes of one shape's files. The engine reads them, so that no stage touches a path."""

    shape: str
    """Name of the shape, for messages: `<class>/<id>`."""
    files: dict[str, bytes] = Field(repr=False)
    """File name (relative to the main file) → bytes; materials and textures included."""
    mesh: str | None = None
    """Which of `files` is the mesh or scene (ply obj off stl glb)."""
    cloud: str | None = None
    """Which of `files` is the point cloud (pcd ply xyz npz)."""
    own_names: dict[str, str] = {}
    """What people call some of the `files`: `mesh.obj` → `m45.obj`; for messages."""
    up: UpAxis | None = "y"
    """Which axis of the files points up; None: to be found (`orient`)."""


class NormalizedShape(Artifact):
    """One shape in the unit frame: the surface to render, and the candidate points that features and keypoints live
    on."""

    kind: Literal["mesh", "cloud"]
    vertices: Annotated[np.ndarray, ArraySpec("v 3", "float32", unit="unit frame")]
    """All vertices (or cloud points) of the file in the file's order; those no face uses stay, at a finite place."""
    faces: Annotated[np.ndarray, ArraySpec("f 3", "int32")]
    """Clean faces: no degenerate, duplicate or non-finite ones. Empty for a cloud."""
    vertex_colors: Annotated[np.ndarray, ArraySpec("v 3", "uint8")] | None = None
    face_uvs: Annotated[np.ndarray, ArraySpec("f 3 2", "float32", unit="texture, origin at the lower left")] | None = (
        None
    )
    texture: Annotated[np.ndarray, ArraySpec("h w 3", "uint8")] | None = None
    points: Annotated[np.ndarray, ArraySpec("n 3", "float32", unit="unit frame")]
    """Candidates: the data set's cloud in its own order, or farthest-point samples of the surface."""
    point_faces: Annotated[np.ndarray, ArraySpec("n", "int32")]
    """Face (an index into `faces`) each candidate lies on or is nearest to; -1 for a cloud without a mesh."""
    point_barycentrics: Annotated[np.ndarray, ArraySpec("n 3", "float32")]
    candidates: Literal["cloud", "fps"]
    center: tuple[float, float, float]
    scale: float
    turn: float = 0.0
    """Degrees by which the shape was turned about +y (from +z towards +x) before it was centred and scaled."""
    up: UpAxis = "y"
    """Which axis of the source frame points up: it was brought to +y before the turn."""
    repairs: dict[str, int]
    """How many of each were handled: unreferenced_vertices, degenerate_faces, duplicate_faces, non_finite_vertices,
    …"""

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) float64: from the source frame's directions to the unit frame's."""
        return turned(self.turn) @ to_y_up(self.up)

    def to_unit(self, positions: np.ndarray) -> np.ndarray:
        """Source frame (…, 3) → unit frame, float64."""
        return (positions @ self.rotation.T - np.asarray(self.center)) / self.scale

    def to_source(self, positions: np.ndarray) -> np.ndarray:
        """Unit frame (…, 3) → source frame, float64."""
        return (positions * self.scale + np.asarray(self.center)) @ self.rotation


def turned(degrees: float) -> np.ndarray:
    """(3, 3) float64: rotation about +y, from +z towards +x; exactly the identity at 0."""
    sin, cos = np.sin(np.deg2rad(degrees)), np.cos(np.deg2rad(degrees))
    return np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
