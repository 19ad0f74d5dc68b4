"""Intrinsic shape signatures' keypoints (Zhong 2009, ICCV Workshops, section 3)."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from b23d.stages.detectors.neighbourhoods import ball_sums, scatter_matrices


def iss(
    points: np.ndarray, radius: float, gamma_21: float, gamma_32: float, min_neighbors: int
) -> npt.NDArray[np.float64]:
    """Saliency (n,): the least eigenvalue of each point's weighted scatter matrix, in units of radius²; 0 where it is
    no keypoint.

    The matrix is taken about the point itself over the ball of `radius`, each neighbour weighing 1 / (its own
    neighbours in the ball), against uneven sampling. A point qualifies where λ2 / λ1 < gamma_21, λ3 / λ2 < gamma_32 (λ1
    ≥ λ2 ≥ λ3: the axes are told apart) and it has at least min_neighbors others. points: (n, 3) float64.
    """
    counts = ball_sums(points, radius, np.ones((len(points), 1)))[:, 0]
    about, _ = scatter_matrices(points, radius, 1 / counts)
    third, second, first = np.linalg.eigvalsh(about / radius**2).T
    distinct = (second < gamma_21 * first) & (third < gamma_32 * second)
    return np.where(distinct & (counts > min_neighbors), third, 0)
