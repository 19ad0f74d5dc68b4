"""Coordinate descent on the choice itself: move one keypoint at a time to its best candidate, from many starts at once.

With the other keypoints fixed, the objective of moving keypoint j to candidate i needs only the totals and

    A[j, i] + Σ_{l ≠ j} M_jl (D[i, c_l] − D_kp,jl)²  =  A[j, i] + Σ M D² − 2 Σ M D_kp D + const,

two products with the columns of D at the current choice, so a move costs O(n k) a start. The norms are not squared,
hence the totals: L = √(ΣA) + α √(ΣR). Every accepted move lowers L, so passes end; starts that reach the same choice
are merged.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from b23d.stages.solvers.hungarian import hungarian
from b23d.stages.solvers.nearest import nearest
from b23d.stages.solvers.objective import Problem, objective, residuals

NEAREST = 32
"""Random starts draw each keypoint among this many candidates with the most similar features."""
GAIN = 1e-5
"""Moves that lower the objective by a smaller share than this are rounding."""


def discrete(
    problem: Problem,
    *,
    starts: int = 32,
    passes: int = 100,
    seed: int = 0,
    one_to_one: bool = False,
    extra: Iterable[np.ndarray] = (),
) -> np.ndarray:
    """Choice (k,) int64 with the least objective found; never worse than any start, nearest neighbour and assignment
    included.

    starts: how many starts in all, besides `extra`: nearest neighbour, assignment, then half of the rest drawn among
    each keypoint's
        nearest candidates, and the other half perturbations of the best choice so far.
    passes: upper bound; a start ends as soon as no move lowers its objective, after three to eight passes in practice.
    extra: further choices to start from, such as the result of another solver.
    one_to_one: no candidate twice. Then starts that repeat a candidate are left out.
    Raises ValueError where `one_to_one` asks for more candidates than there are.
    """
    random = np.random.default_rng(seed)
    fixed = [
        nearest(problem),
        *([hungarian(problem)] if problem.k <= problem.n or one_to_one else []),
        *map(np.asarray, extra),
    ]
    free = max(starts - 2, 0)
    pool = problem.feature_costs.argsort(1)[:, :NEAREST]  # (k, m)

    first = np.concatenate([np.stack(fixed), _draws(pool, free - free // 2, random)])
    best = _best(problem, first, passes, one_to_one)
    second = np.concatenate([best[None], _perturbed(best, pool, free // 2, random)])
    return _best(problem, second, passes, one_to_one)


def descend(problem: Problem, choices: np.ndarray, passes: int = 100, one_to_one: bool = False) -> np.ndarray:
    """Local optima reached from `choices` (s, k): no single move to another candidate lowers the objective any more,
    unless `passes` over all keypoints were too few. All starts move at once; those that have arrived leave.

    Returns (≤ s, k) int64, equal ones merged.
    """
    done: list[np.ndarray] = []
    choices = np.unique(choices, axis=0)
    for _ in range(passes):
        before = choices
        choices = _pass(problem, choices.copy(), one_to_one)
        still = (choices == before).all(1)
        done.append(choices[still])
        choices = np.unique(choices[~still], axis=0)
        if not len(choices):
            break
    return np.unique(np.concatenate([*done, choices]), axis=0)


def _best(problem: Problem, starts: np.ndarray, passes: int, one_to_one: bool) -> np.ndarray:
    if one_to_one:
        starts = starts[(np.diff(np.sort(starts, axis=1), axis=1) > 0).all(1)]
    reached = np.concatenate(
        [descend(problem, starts, passes, one_to_one), starts]
    )  # float32 passes, judged in float64
    return reached[objective(problem, reached).argmin()]


def _pass(problem: Problem, choices: np.ndarray, one_to_one: bool) -> np.ndarray:
    """One move of every keypoint of every start; `choices` (s, k) is changed and returned."""
    starts, k = choices.shape
    rows = np.arange(starts)
    feature_costs = problem.feature_costs.astype(np.float32)  # A (k, n)
    mask = (problem.mask & ~np.eye(k, dtype=bool)).astype(np.float32)
    known = np.where(mask > 0, problem.target_distances, 0).astype(np.float32)
    twice_known = 2 * known
    columns = problem.distances[choices.T]  # D[:, c] (k, s, n)
    squares = columns**2

    features, distances = residuals(problem, choices)  # (s, k), (s, k, k) float64
    for j in range(k):
        others = features.sum(1) - features[:, j]
        feature_total = (others[:, None] + feature_costs[j]).astype(np.float32)
        np.maximum(feature_total, 0, out=feature_total)

        off = distances.sum((1, 2)) - distances[:, j].sum(1) - distances[:, :, j].sum(1)  # the diagonal is zero
        moved = _product(mask[j], squares) - _product(twice_known[j], columns)
        moved += (known[j] ** 2).sum()
        distance_total = off[:, None].astype(np.float32) + 2 * moved
        np.maximum(distance_total, 0, out=distance_total)

        value = np.sqrt(feature_total, out=feature_total)
        value += problem.alpha * np.sqrt(distance_total, out=distance_total)
        current = value[rows, choices[:, j]]
        if one_to_one:
            taken = np.delete(choices, j, axis=1)
            value[rows[:, None], taken] = np.inf
        to = value.argmin(1)
        moves = rows[value[rows, to] < current * (1 - GAIN)]
        if not len(moves):
            continue
        choices[moves, j] = to[moves]
        columns[j, moves] = problem.distances[to[moves]]
        squares[j, moves] = columns[j, moves] ** 2
        features[moves], distances[moves] = residuals(problem, choices[moves])
    return choices


def _product(weights: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Σ_l weights_l columns_l: (k,), (k, s, n) → (s, n)."""
    k, starts, n = columns.shape
    return (weights @ columns.reshape(k, -1)).reshape(starts, n)


def _draws(pool: np.ndarray, count: int, random: np.random.Generator) -> np.ndarray:
    k, size = pool.shape
    return pool[np.arange(k), random.integers(size, size=(count, k))]


def _perturbed(best: np.ndarray, pool: np.ndarray, count: int, random: np.random.Generator) -> np.ndarray:
    """Copies of `best` in which about a third of the keypoints (at least one) are drawn anew, (count, k)."""
    k = len(best)
    drawn = random.random((count, k)) < 1 / 3
    drawn[np.arange(count), random.integers(k, size=count)] = True
    return np.where(drawn, _draws(pool, count, random), best)
