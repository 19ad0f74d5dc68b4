"""Annotated keypoints on a shape's candidates."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from b23d.schemas.keypoints import Keypoints
from b23d.schemas.shape import NormalizedShape


def check_keypoints(keypoints: Keypoints, shape: NormalizedShape, name: str = "the shape") -> None:
    """Raise ValueError where a keypoint's point index lies beyond the data set's cloud.

    Only the geometry tells how long the cloud is, so this cannot be checked when the annotation is read. Where the
    candidates are not that cloud, indices are not used and not checked.
    """
    if shape.candidates != "cloud":
        return
    wrong = np.flatnonzero(keypoints.point_indices >= len(shape.points))
    if len(wrong):
        first = int(wrong[0])
        raise ValueError(
            f"keypoint {keypoints.ids[first]} of {name}: expected a point index below {len(shape.points)}, "
            f"got {keypoints.point_indices[first]}; mend the annotation file"
        )


def keypoint_candidates(keypoints: Keypoints, shape: NormalizedShape, name: str = "the shape") -> npt.NDArray[np.int64]:
    """The candidate of each keypoint: (k,) indices into `shape.points`.

    Its point index where the candidates are the data set's cloud and the annotation has one; else the candidate nearest
    to its position. Raises ValueError as `check_keypoints`.
    """
    check_keypoints(keypoints, shape, name)
    if shape.candidates == "cloud" and (keypoints.point_indices >= 0).all():
        return keypoints.point_indices.astype(np.int64)
    from scipy.spatial import cKDTree

    unit = shape.to_unit(keypoints.positions)
    _, nearest = cKDTree(shape.points.astype(np.float64)).query(unit)
    nearest = np.asarray(nearest, np.int64).reshape(-1)
    if shape.candidates == "cloud":
        return np.where(keypoints.point_indices >= 0, keypoints.point_indices, nearest)
    return nearest
