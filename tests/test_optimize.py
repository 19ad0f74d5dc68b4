"""The optimize stage: that the target gives what the shots ask for, by any solver, and that what is wrong is said."""

from __future__ import annotations

import numpy as np
import pytest

from b23d.schemas.keypoints import Keypoints
from tests.made_spheres import AT, IDS, distances_of, features_of, keypoints_of, labelled, shape_of, solve, sphere


@pytest.mark.parametrize("method", ["discrete", "nearest", "hungarian"])
def test_the_shot_itself_as_target_gives_its_keypoints(method: str) -> None:
    shot = labelled(0, IDS, AT)
    found = solve(shot, [shot], method=method)
    assert found.ids.tolist() == IDS
    assert found.points.tolist() == AT
    assert found.objective == pytest.approx(0, abs=1e-3)
    assert np.array_equal(found.positions, shot[0].points[AT])
    assert found.present.all()
    assert (found.method, found.shots) == (method, ["0"])


def test_costs_sum_to_the_objective() -> None:
    found = solve(labelled(1, [], []), [labelled(0, IDS, AT)], method="hungarian")
    assert found.costs.sum() == pytest.approx(found.objective, rel=1e-5)


def test_discrete_is_best_by_the_common_objective() -> None:
    target, shots = labelled(1, [], []), [labelled(0, IDS, AT), labelled(2, IDS, AT)]
    reached = {
        method: solve(target, shots, method=method, **({"steps": 200} if method == "softmax" else {})).objective
        for method in ("discrete", "softmax", "nearest", "hungarian")
    }
    assert reached["discrete"] == min(reached.values())
    with_softmax = solve(target, shots, starts=2, softmax_start=True, softmax={"steps": 200}).objective
    assert with_softmax <= reached["softmax"]


def test_the_discrete_search_is_the_params() -> None:
    """Restarts, the bound on passes and one candidate a keypoint."""
    target, shots = (
        labelled(1, [], []),
        [labelled(0, list(range(8)), [3, 3, 3, 50, 50, 120, 120, 180]), labelled(2, [0, 1], AT[:2])],
    )
    few, many = (solve(target, shots, alpha=2, starts=starts).objective for starts in (2, 64))
    cut = solve(target, shots, alpha=2, starts=2, passes=1).objective
    assert many <= few <= cut
    free, apart = (solve(target, shots, alpha=2, one_to_one=one).points for one in (False, True))
    assert len(set(free)) < 8 == len(set(apart))


def test_order_of_candidates_does_not_matter() -> None:
    shots = [labelled(0, IDS, AT), labelled(2, IDS, AT)]
    points, features, distances = sphere(1)
    order = np.random.default_rng(0).permutation(len(points))
    plain = (shape_of(points), features_of(features), distances_of(distances), keypoints_of([], [], points))
    shuffled = (
        shape_of(points[order]),
        features_of(features[order]),
        distances_of(distances[np.ix_(order, order)]),
        plain[3],
    )
    assert np.array_equal(solve(plain, shots).positions, solve(shuffled, shots).positions)


def test_same_seed_same_prediction() -> None:
    target, shots = labelled(1, [], []), [labelled(0, IDS, AT)]
    for method in ("discrete", "softmax"):
        first, second = (solve(target, shots, method=method, steps=20, seed=5) for _ in range(2))
        assert np.array_equal(first.points, second.points)
        assert first.objective == second.objective


def test_scales_of_shape_and_features_do_not_matter() -> None:
    shots = [labelled(0, IDS, AT)]
    points, features, distances = sphere(1)
    plain = (shape_of(points), features_of(features), distances_of(distances), shots[0][3])
    other = (shape_of(points), features_of(4 * features), distances_of(distances / 4), shots[0][3])
    assert np.array_equal(solve(plain, shots).points, solve(other, shots).points)
    assert solve(plain, shots).objective == pytest.approx(solve(other, shots).objective, rel=1e-3)
    assert solve(other, shots, features="raw").objective > 10 * solve(plain, shots, features="raw").objective
    assert (
        solve(plain, shots, distances="unit-frame").objective != solve(other, shots, distances="unit-frame").objective
    )


def test_unreachable_pairs_of_the_target_count_as_its_largest_distance() -> None:
    points, features, distances = sphere(1)
    distances[:100, 100:] = distances[100:, :100] = np.inf
    target = (shape_of(points), features_of(features), distances_of(distances), keypoints_of([], [], points))
    found = solve(target, [labelled(0, IDS, AT)])
    assert np.isfinite(found.objective)


def test_features_of_different_encoders() -> None:
    points, features, distances = sphere(3, channels=5)
    other = (shape_of(points), features_of(features), distances_of(distances), keypoints_of(IDS, AT, points))
    with pytest.raises(ValueError, match=r"expected 5 channels as the shots have \(test\), got 12"):
        solve(labelled(1, [], []), [other])
    with pytest.raises(ValueError, match="as many channels in every shot"):
        solve(labelled(1, [], []), [other, labelled(0, IDS, AT)])
    with pytest.raises(ValueError, match=r"expected 5 channels as the shots have \(test\), got 12"):
        solve(labelled(1, [], []), [other, other], retrieval=True)


def test_features_that_do_not_fit_the_candidates_or_are_no_numbers() -> None:
    target, one = labelled(1, [], []), labelled(0, IDS, AT)
    with pytest.raises(ValueError, match="the target: expected features and distances of its 200 candidates, got 10"):
        solve((target[0], features_of(np.ones((10, 12))), *target[2:]), [one])
    broken = np.ones((200, 12))
    broken[3] = np.nan
    with pytest.raises(ValueError, match="shot 0: expected finite features"):
        solve(target, [(one[0], features_of(broken), *one[2:])])


def test_keypoint_beyond_the_cloud() -> None:
    points = sphere(0)[0]
    wrong = Keypoints(
        ids=np.array([0], np.int32), positions=points[:1].astype(float), point_indices=np.array([4000], np.int32)
    )
    with pytest.raises(ValueError, match="shot 0: expected a point index below 200, got 4000"):
        solve(labelled(1, [], []), [(*labelled(0, [], [])[:3], wrong)])
