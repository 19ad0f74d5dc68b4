"""Solvers: the objective by hand, optima by brute force, and who may never be worse than whom."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from b23d.stages.solvers.discrete import descend, discrete
from b23d.stages.solvers.hungarian import hungarian
from b23d.stages.solvers.nearest import nearest
from b23d.stages.solvers.objective import Problem, objective, residuals, shares


def random_problem(seed: int, n: int = 40, k: int = 5, alpha: float = 0.5, channels: int = 6) -> Problem:
    """Features without any relation to the positions, whose distances are wanted of other positions: as hard as it
    gets."""
    random = np.random.default_rng(seed)
    features, wanted = random.normal(size=(n, channels)), random.normal(size=(k, channels))
    return _problem(random.normal(size=(n, 3)), features, wanted, random.normal(size=(k, 3)), alpha)


def structured_problem(seed: int, n: int = 300, k: int = 8, alpha: float = 0.5) -> Problem:
    """Points of a box with features that cannot tell left from right, and keypoints that are among the points, moved a
    little."""
    random = np.random.default_rng(seed)
    points = random.uniform(-0.5, 0.5, (n, 3))
    features = np.column_stack([np.abs(points[:, 0]), points[:, 1:]]) + 0.05 * random.normal(size=(n, 3))
    chosen = random.choice(n, k, replace=False)
    moved = points[chosen] + 0.02 * random.normal(size=(k, 3))
    return _problem(points, features, features[chosen] + 0.05 * random.normal(size=(k, 3)), moved, alpha)


def _problem(
    points: np.ndarray, features: np.ndarray, wanted: np.ndarray, keypoints: np.ndarray, alpha: float
) -> Problem:
    return Problem(
        features=features.astype(np.float32),
        distances=_between(points).astype(np.float32),
        target_features=wanted.astype(np.float32),
        target_distances=_between(keypoints),
        mask=~np.eye(len(keypoints), dtype=bool),
        alpha=alpha,
    )


def _between(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points[:, None] - points[None], axis=2)


def _square() -> Problem:
    """A square's corners: all features alike (but for a little), so features alone send every keypoint to one
    corner."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float)
    features = np.array([[0.0], [0.1], [0.1], [0.1]])
    return _problem(corners, features, np.zeros((4, 1)), corners, 1.0)


def _optimum(problem: Problem, one_to_one: bool = False) -> float:
    choose = itertools.permutations if one_to_one else lambda items, k: itertools.product(items, repeat=k)
    return float(objective(problem, np.array(list(choose(range(problem.n), problem.k)))).min())


def test_objective_by_hand() -> None:
    points = np.array([[0, 0, 0], [3, 0, 0], [0, 4, 0]], float)
    problem = _problem(
        points, np.array([[0.0, 0], [1, 0], [0, 2]]), np.zeros((2, 2)), np.array([[0, 0, 0], [1, 0, 0]], float), 0.5
    )
    # candidates 1 and 2: features off by 1 and 2; they are 5 apart instead of 1, which counts in both halves of the
    # matrix
    assert objective(problem, np.array([1, 2])) == pytest.approx(np.sqrt(1 + 4) + 0.5 * np.sqrt(2 * 16))


def test_objective_of_the_truth_is_zero() -> None:
    random = np.random.default_rng(0)
    points, features, truth = random.normal(size=(30, 3)), random.normal(size=(30, 4)), np.array([3, 14, 15, 9])
    problem = _problem(points, features, features[truth], points[truth], 2.0)
    assert objective(problem, truth) == pytest.approx(0, abs=1e-5)
    for solve in (nearest, hungarian, discrete):
        assert np.array_equal(solve(problem), truth)


def test_many_objectives_at_once_are_each_alone() -> None:
    problem = random_problem(0)
    choices = np.random.default_rng(1).integers(problem.n, size=(7, problem.k))
    assert np.allclose(objective(problem, choices), [objective(problem, choice) for choice in choices])


def test_shares_sum_to_the_objective() -> None:
    problem, choice = random_problem(2), np.arange(5)
    assert shares(problem, choice).sum() == pytest.approx(float(objective(problem, choice)))
    assert (shares(problem, choice) >= 0).all()


def test_masked_pairs_do_not_count_even_if_they_are_not_a_number() -> None:
    problem = random_problem(3)
    mask = problem.mask.copy()
    mask[0, 1] = mask[1, 0] = False
    unknown = problem.target_distances.copy()
    unknown[0, 1] = unknown[1, 0] = np.nan
    plain, holes = replace(problem, mask=mask), replace(problem, mask=mask, target_distances=unknown)
    choice = np.arange(5)
    assert objective(plain, choice) == objective(holes, choice)
    assert residuals(plain, choice)[1][0, 1] == 0
    assert np.array_equal(discrete(plain), discrete(holes))


def test_feature_costs_keep_their_digits_under_a_large_offset() -> None:
    problem = random_problem(4)
    offset = np.float32(1000)
    moved = replace(problem, features=problem.features + offset, target_features=problem.target_features + offset)
    exact = ((problem.features[None].astype(float) - problem.target_features[:, None]) ** 2).sum(2)
    assert np.allclose(problem.feature_costs, exact, atol=1e-6)
    assert np.allclose(moved.feature_costs, exact, rtol=1e-3, atol=1e-3)  # what is lost is float32's, in the sum above


@pytest.mark.parametrize("one_to_one", [False, True])
@pytest.mark.parametrize("seed", range(20))
def test_discrete_reaches_the_brute_force_optimum(seed: int, one_to_one: bool) -> None:
    problem = random_problem(seed, n=8, k=3)
    reached = float(objective(problem, discrete(problem, one_to_one=one_to_one)))
    assert reached == pytest.approx(_optimum(problem, one_to_one), rel=1e-6)


@pytest.mark.parametrize("alpha", [0.0, 0.25, 4.0])
@pytest.mark.parametrize("make", [random_problem, structured_problem])
def test_discrete_is_never_worse_than_nearest_and_hungarian(make: Callable[..., Problem], alpha: float) -> None:
    for seed in range(5):
        problem = make(seed, alpha=alpha)
        for starts in (1, 2, 8):
            reached = objective(problem, discrete(problem, starts=starts))
            assert reached <= objective(problem, nearest(problem))
            assert reached <= objective(problem, hungarian(problem))


def test_discrete_is_never_worse_than_a_given_start() -> None:
    problem = random_problem(5, n=200, k=10, alpha=4)
    best = discrete(problem, starts=256, seed=1)
    assert objective(problem, discrete(problem, starts=1, extra=[best])) <= objective(problem, best)


@pytest.mark.parametrize("make", [random_problem, structured_problem])
def test_discrete_is_never_worse_than_softmax_on_a_sample(make: Callable[..., Problem]) -> None:
    from b23d.stages.solvers.softmax import softmax

    for seed in range(2):
        problem = make(seed)
        assert objective(problem, discrete(problem)) <= objective(problem, softmax(problem, steps=400))


def test_local_optima_allow_no_better_single_move() -> None:
    problem = structured_problem(1, n=60, k=4)
    for choice in descend(problem, np.random.default_rng(0).integers(60, size=(5, 4))):
        moves = np.repeat(choice[None], 4 * 60, axis=0)
        moves[np.arange(240), np.repeat(np.arange(4), 60)] = np.tile(np.arange(60), 4)
        assert objective(problem, moves).min() >= objective(problem, choice) * (1 - 1e-4)


def test_starts_move_together_as_each_alone_and_leave_when_they_have_arrived(monkeypatch: pytest.MonkeyPatch) -> None:
    from b23d.stages.solvers import discrete as module

    problem = structured_problem(12, n=80, k=5)
    starts = np.random.default_rng(0).integers(80, size=(12, 5))
    alone = np.unique(np.concatenate([descend(problem, start[None]) for start in starts]), axis=0)
    moving: list[int] = []
    one_pass = module._pass

    def counted(problem: Problem, choices: np.ndarray, one_to_one: bool) -> np.ndarray:
        moving.append(len(choices))
        return one_pass(problem, choices, one_to_one)

    monkeypatch.setattr(module, "_pass", counted)
    assert np.array_equal(descend(problem, starts), alone)
    assert moving[0] == 12
    assert moving == sorted(moving, reverse=True)
    assert 2 < len(moving) < 15, "far from the bound of 100"


def test_fewer_passes_stop_earlier() -> None:
    problem = random_problem(13, n=200, k=10, alpha=4)
    reached = [float(objective(problem, discrete(problem, starts=2, passes=passes))) for passes in (1, 100)]
    assert reached[1] < reached[0]


def test_more_starts_are_never_worse_from_the_same_optimum() -> None:
    problem = random_problem(6, n=100, k=8, alpha=2)
    few, many = (float(objective(problem, discrete(problem, starts=starts))) for starts in (1, 128))
    assert many <= few


def test_without_distances_discrete_is_nearest() -> None:
    problem = structured_problem(2, alpha=0)
    assert np.array_equal(discrete(problem), nearest(problem))


def test_distances_undo_the_collapse_on_a_square() -> None:
    problem = _square()
    assert len(set(nearest(problem))) == 1
    assert sorted(discrete(problem)) == [0, 1, 2, 3]


def test_a_single_keypoint_has_no_pairs() -> None:
    problem = random_problem(7, k=1)
    assert np.array_equal(discrete(problem), nearest(problem))
    assert np.array_equal(discrete(problem, one_to_one=True), nearest(problem))


def test_hungarian_keeps_labels_and_repeats_nothing() -> None:
    features = np.arange(6.0)[:, None]
    problem = _problem(np.zeros((6, 3)), features, np.array([[5.0], [0.1], [3.0]]), np.zeros((3, 3)), 0)
    assert hungarian(problem).tolist() == [5, 0, 3]
    crowded = _problem(np.zeros((6, 3)), features, np.array([[2.0], [2.1], [1.9]]), np.zeros((3, 3)), 0)
    assert len(set(hungarian(crowded))) == 3


def test_one_to_one_repeats_nothing_where_free_choice_would() -> None:
    from b23d.stages.solvers.softmax import softmax

    problem = structured_problem(3, alpha=0, k=6)
    problem = replace(problem, target_features=np.repeat(problem.target_features[:1], 6, axis=0))
    assert len(set(discrete(problem))) == 1
    assert len(set(discrete(problem, one_to_one=True))) == 6
    assert len(set(softmax(problem, steps=50, one_to_one=True))) == 6


def test_too_few_candidates_for_one_to_one() -> None:
    problem = random_problem(8, n=3, k=5)
    assert len(discrete(problem)) == 5
    with pytest.raises(ValueError, match="expected at least 5 candidates, got 3"):
        discrete(problem, one_to_one=True)


def test_same_seed_same_choice() -> None:
    from b23d.stages.solvers.softmax import softmax

    problem = random_problem(9, n=80, k=8, alpha=4)
    assert np.array_equal(discrete(problem, seed=3), discrete(problem, seed=3))
    assert np.array_equal(softmax(problem, steps=30, seed=3), softmax(problem, steps=30, seed=3))
    assert not np.array_equal(softmax(problem, steps=0, seed=3), softmax(problem, steps=0, seed=4))


def test_order_of_candidates_does_not_matter() -> None:
    problem = structured_problem(4)
    order = np.random.default_rng(0).permutation(problem.n)
    shuffled = replace(problem, features=problem.features[order], distances=problem.distances[np.ix_(order, order)])
    for solve in (nearest, hungarian, discrete):
        assert np.array_equal(order[solve(shuffled)], solve(problem))


@pytest.mark.parametrize("beta", [0.0, 0.7])
def test_softmax_gradient_is_autograd_s(beta: float) -> None:
    import torch

    from b23d.stages.solvers.softmax import SelectionLoss

    problem = random_problem(10, n=20, k=4)
    logits = torch.randn(5, 20, generator=torch.Generator().manual_seed(0))
    loss, gradient = SelectionLoss(problem, beta)(logits)

    variable = logits.clone().requires_grad_()
    selection = torch.softmax(variable, 0)[:-1].T
    features, distances = torch.from_numpy(problem.features), torch.from_numpy(problem.distances)
    between = torch.from_numpy(problem.target_distances).float()
    expected = (selection.T @ features - torch.from_numpy(problem.target_features)).norm()
    expected = (
        expected
        + problem.alpha * ((selection.T @ distances @ selection - between) * torch.from_numpy(problem.mask)).norm()
    )
    expected = expected - beta * (selection.max(0).values - selection.mean(0)).sum()
    expected.backward()
    assert loss.item() == pytest.approx(expected.item(), rel=1e-5)
    assert torch.allclose(gradient, variable.grad, atol=1e-6)


def test_softmax_finds_an_unambiguous_truth() -> None:
    from b23d.stages.solvers.softmax import softmax

    random = np.random.default_rng(0)
    points, features, truth = random.normal(size=(50, 3)), 3 * random.normal(size=(50, 16)), np.array([7, 30, 2])
    problem = _problem(points, features, features[truth], points[truth], 0.5)
    assert np.array_equal(softmax(problem, steps=1000), truth)
