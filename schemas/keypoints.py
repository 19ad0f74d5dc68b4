"""Human keypoints of one shape."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from b23d.schemas.artifact import ArraySpec, Artifact


class Keypoints(Artifact):
    """Human keypoints of one shape, in KeypointNet's sense."""

    ids: Annotated[np.ndarray, ArraySpec("k", "int32")]
    """Semantic id of each keypoint; unique within a shape."""
    positions: Annotated[np.ndarray, ArraySpec("k 3", "float64", unit="source frame")]
    point_indices: Annotated[np.ndarray, ArraySpec("k", "int32")]
    """Index into the data set's cloud (`pcd_info.point_index`), or -1 where the annotation has none."""
    reflections: list[tuple[int, ...]] = []
    """Ids that a mirror symmetry of the shape exchanges. (KeypointNet's `symmetries.reflection[].kp_indexes` are places
    in the keypoint list, not ids; they are turned into ids on loading.)"""
    rotations: list[tuple[int, ...]] = []
    """Ids that a rotational symmetry of the shape exchanges."""
    names: dict[int, str] = {}
    """Semantic id → name, for ids that the annotation names. For people's eyes alone: never part of any address.
    `b23d.stages.datasets.names.keypoint_names` gives those of a whole class."""
    annotation_file: str = ""
    """sha256 of the file the annotation came from; recorded with scores, not part of any address."""
