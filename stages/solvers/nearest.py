"""Nearest neighbour: every keypoint takes the candidate with the most similar feature, on its own."""

from __future__ import annotations

import numpy as np

from b23d.stages.solvers.objective import Problem


def nearest(problem: Problem) -> np.ndarray:
    """Choice (k,) int64 that minimises L_feature alone; keypoints may share a candidate."""
    return problem.feature_costs.argmin(1)
