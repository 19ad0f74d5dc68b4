"""Hungarian baseline: the linear assignment of keypoints to candidates, no candidate twice.

Jonker–Volgenant with modifications (D. F. Crouse, On implementing 2D rectangular assignment algorithms, 2016), scipy's.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from b23d.stages.solvers.objective import Problem

Assignment = Literal["labelled", "sorted"]


def hungarian(problem: Problem, order: Assignment = "labelled") -> np.ndarray:
    """Choice (k,) int64 with the least sum of feature distances among choices without repetition, in the keypoints'
    order.

    order "sorted": the same candidates by index, whichever keypoint each was assigned to, as the published code returns
    them. Raises ValueError where there are more keypoints than candidates.
    """
    from scipy.optimize import linear_sum_assignment

    if problem.k > problem.n:
        raise ValueError(
            f"the target: expected at least {problem.k} candidates, got {problem.n}; sample more, one for each keypoint"
        )
    # rows come back sorted, so columns are in the keypoints' order: labels stay
    choice: np.ndarray = linear_sum_assignment(np.sqrt(problem.feature_costs))[1]
    return choice if order == "labelled" else np.sort(choice)
