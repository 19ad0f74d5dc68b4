"""Solvers of other libraries on the same problem: POT's semi-relaxed fused Gromov–Wasserstein, scipy's quadratic
assignment.

None earns a place in the project: see `bench_solvers.py`, which measures them. They minimise other things than the
objective: squares in the place of norms, so that α has to be translated (`trade_off`); and the quadratic assignment
knows no sum of squares over a choice of candidates, only a product of affinities.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec

import numpy as np

from b23d.stages.solvers.discrete import descend
from b23d.stages.solvers.nearest import nearest
from b23d.stages.solvers.objective import Problem, objective, residuals

Solver = Callable[[Problem], np.ndarray]


def outside_solvers() -> dict[str, Solver]:
    """By name; prints why some are left out."""
    found: dict[str, Solver] = {
        "scipy faq, 16 each": lambda p: quadratic_assignment(p, "faq", 16),
        "scipy faq, descended": lambda p: descended(p, quadratic_assignment(p, "faq", 16)),
        "scipy 2opt, 4 each": lambda p: quadratic_assignment(p, "2opt", 4),
    }
    if find_spec("ot") is None:
        print("skipped: semi-relaxed fused Gromov–Wasserstein needs POT (pip install pot)")
    else:
        found["POT srFGW"] = gromov_wasserstein
        found["POT srFGW, descended"] = lambda p: descended(p, gromov_wasserstein(p))
        found["POT srFGW, entropic"] = lambda p: gromov_wasserstein(p, entropy=0.01)
    return found


def gromov_wasserstein(problem: Problem, entropy: float = 0.0, rounds: int = 2) -> np.ndarray:
    """Each keypoint sends its mass to candidates, whose masses are free (Vincent-Cuaz et al., ICLR 2022): (k,) where
    most of it arrives.

    entropy: of mirror descent; 0: conditional gradient. rounds: of translating α at the choice reached.
    """
    from ot.gromov import entropic_semirelaxed_fused_gromov_wasserstein, semirelaxed_fused_gromov_wasserstein

    costs, wanted = problem.feature_costs, completed(problem)
    between = problem.distances.astype(np.float64)
    choice = nearest(problem)
    for _ in range(rounds):
        share = trade_off(problem, choice) * problem.k
        share /= 1 + share  # features weigh (1 − share) / k, distances share / k²
        if entropy:
            plan = entropic_semirelaxed_fused_gromov_wasserstein(
                costs, wanted, between, symmetric=True, epsilon=entropy, alpha=share, max_iter=300
            )
        else:
            plan = semirelaxed_fused_gromov_wasserstein(
                costs, wanted, between, symmetric=True, alpha=share, max_iter=300
            )
        choice = plan.argmax(1)
    return choice


def quadratic_assignment(problem: Problem, method: str, each: int, width: float = 0.3) -> np.ndarray:
    """scipy's, among the `each` candidates most like each keypoint; distances as Gaussian affinities, features as ties
    to anchors."""
    from scipy.optimize import quadratic_assignment

    pool = np.unique(problem.feature_costs.argsort(1)[:, :each])
    p, k = len(pool), problem.k
    costs, weight = problem.feature_costs[:, pool], trade_off(problem, nearest(problem))
    candidates, keypoints = np.zeros((p + k, p + k)), np.zeros((p + k, p + k))
    candidates[:p, :p] = np.exp(-(problem.distances[np.ix_(pool, pool)].astype(np.float64) ** 2) / width**2)
    keypoints[:k, :k] = np.exp(-(completed(problem) ** 2) / width**2)
    candidates[:p, p:] = (costs.max() - costs).T / (2 * weight * width**2 + 1e-9)
    keypoints[:k, p:] = np.eye(k)
    anchors = np.repeat(p + np.arange(k)[:, None], 2, axis=1)
    result = quadratic_assignment(
        candidates, keypoints, method=method, options={"maximize": True, "partial_match": anchors}
    )
    return pool[np.argsort(result.col_ind)[:k]]


def descended(problem: Problem, choice: np.ndarray) -> np.ndarray:
    """The local optimum that single moves reach from it."""
    reached = descend(problem, choice[None])
    return reached[objective(problem, reached).argmin()]


def completed(problem: Problem) -> np.ndarray:
    """Wanted distances (k, k), pairs that no shot has by the shortest way over those that some shot has."""
    from scipy.sparse.csgraph import floyd_warshall

    known = np.where(problem.mask, np.maximum(problem.target_distances, 1e-9), np.inf)
    np.fill_diagonal(known, 0)
    joined = floyd_warshall(known)
    return np.where(np.isinf(joined), float(problem.distances.max()), joined)


def trade_off(problem: Problem, choice: np.ndarray) -> float:
    """w for which A + w R has the slopes of √A + α √R at `choice`; A, R the squared feature and distance residuals."""
    features, squares = residuals(problem, choice)
    return float(problem.alpha * np.sqrt(features.sum() / max(squares.sum(), 1e-12)))
