"""Geodesic distances between predicted and annotated keypoints, as KeypointNet's protocol measures them.

The 20-nearest-neighbour graph of the cloud, edges as long as they are, shortest paths (You et al., KeypointNet, CVPR
2020; UKPGAN, CVPR 2022). Pairs that no path joins are infinitely far here; the libraries of that time gave 0 for them,
a hit.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from b23d.schemas.keypoints import Keypoints
from b23d.schemas.shape import NormalizedShape
from b23d.stages.geodesics.graph import graph_distances
from b23d.stages.geometry.keypoints import keypoint_candidates

SAME = 1e-6
"""A keypoint this near to a candidate (unit frame) is that candidate: float32 rounding, not a different place."""


def keypoint_distances(
    shape: NormalizedShape,
    predicted: np.ndarray,
    keypoints: Keypoints,
    neighbors: int = 20,
    units: Literal["dataset", "unit"] = "dataset",
) -> npt.NDArray[np.float64]:
    """Distance of every prediction from every annotated keypoint, (k, g), in the data set's units or in the unit
    frame's.

    predicted: (k,) indices of candidates.

    An annotated keypoint that is no candidate (candidates sampled from a mesh) becomes a node of the graph of its own.
    Raises ValueError where a keypoint's point index lies beyond the cloud.
    """
    points = shape.points.astype(np.float64)
    at = keypoint_candidates(keypoints, shape)
    if shape.candidates != "cloud" or (keypoints.point_indices < 0).any():
        own = shape.to_unit(keypoints.positions)
        off = np.linalg.norm(own - points[at], axis=1) > SAME
        off &= (keypoints.point_indices < 0) | (shape.candidates != "cloud")
        nodes, which = np.unique(own[off], axis=0, return_inverse=True)  # keypoints at one place are one node
        at = at.copy()
        at[off] = len(points) + which.reshape(-1)
        points = np.concatenate([points, nodes])
    if units == "dataset":
        points = points * shape.scale
    sources, rows = np.unique(predicted, return_inverse=True)
    return graph_distances(points, neighbors, sources)[rows][:, at]
