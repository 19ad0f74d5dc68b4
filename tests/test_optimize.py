"""The optimize stage: what the shots ask for, row by row, and that the target gives it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.predictions import Prediction
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.shot_model import ShotModel
from b23d.stages.learn import learn
from b23d.stages.optimize import optimize
from b23d.stages.solvers.learn_options import LearnParams
from b23d.stages.solvers.scaling import relative_distances, scale_features
from b23d.stages.solvers.template import Template, smooth_among, template_of
from tests.made_params import of_learn_and_optimize

Labelled = tuple[NormalizedShape, PointFeatures, GeodesicDistances, Keypoints]


def shape_of(points: np.ndarray, scale: float = 1.0) -> NormalizedShape:
    n = len(points)
    return NormalizedShape(
        kind="cloud",
        vertices=points.astype(np.float32),
        faces=np.zeros((0, 3), np.int32),
        points=points.astype(np.float32),
        point_faces=np.full(n, -1, np.int32),
        point_barycentrics=np.zeros((n, 3), np.float32),
        candidates="cloud",
        center=(0.0, 0.0, 0.0),
        scale=scale,
        repairs={},
    )


def features_of(features: np.ndarray, token: np.ndarray | None = None) -> PointFeatures:
    n = len(features)
    return PointFeatures(
        features=features.astype(np.float16),
        counts=np.ones(n, np.int32),
        observed=np.ones(n, bool),
        class_token=None if token is None else token.astype(np.float32),
        descriptor="test",
    )


def distances_of(distances: np.ndarray) -> GeodesicDistances:
    return GeodesicDistances(
        distances=distances.astype(np.float16), components=np.zeros(len(distances), np.int32), method="test"
    )


def keypoints_of(ids: list[int], indices: list[int], points: np.ndarray) -> Keypoints:
    return Keypoints(
        ids=np.array(ids, np.int32),
        positions=points[indices].astype(np.float64).reshape(-1, 3),
        point_indices=np.array(indices, np.int32),
    )


def sphere(seed: int, n: int = 200, channels: int = 12) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points on a sphere of diameter 1, smooth features of the position, great-circle distances."""
    random = np.random.default_rng(seed)
    directions = random.normal(size=(n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    waves = np.random.default_rng(99).normal(size=(3, channels))
    angles = np.arccos(np.clip(directions @ directions.T, -1, 1))
    np.fill_diagonal(angles, 0)
    return directions / 2, np.sin(2 * directions @ waves) + 5, angles / 2


def labelled(seed: int, ids: list[int], indices: list[int], token: np.ndarray | None = None) -> Labelled:
    points, features, distances = sphere(seed)
    return shape_of(points), features_of(features, token), distances_of(distances), keypoints_of(ids, indices, points)


def solve(target: Labelled, shots: list[Labelled], **params: Any) -> Prediction:
    """The paper's objective by the discrete solver, unless told otherwise; the posterior method has its own tests."""
    teaching, search = of_learn_and_optimize(**{"method": "discrete", **params})
    model = learn(*(list(column) for column in zip(*shots, strict=True)), teaching)  # type: ignore[arg-type]
    return optimize(*target[:3], model, search)


IDS, AT = [0, 2, 5, 9], [3, 50, 120, 180]


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


# what the shots ask for (the table of differences: `test_rows_choice.py`)


Few = tuple[list[int], list[float], np.ndarray]
"""Ids of a shot, the one channel of each keypoint's feature, and their mutual distances, as the shot has them."""


def combined(*shots: Few, weights: list[float] | None = None, **template: Any) -> Template:
    """The template of shots of which this alone is known."""
    ids = sorted({i for own, _, _ in shots for i in own})
    model = learn_stand_in(ids, shots, {"combine": "mean", "mask": "pairs", **template})
    return template_of(model, np.array(weights or [1.0] * len(shots)))


def learn_stand_in(ids: list[int], shots: Sequence[Few], template: dict[str, Any]) -> ShotModel:
    made = learn(*(list(column) for column in zip(*[labelled(0, IDS, AT)], strict=True)), LearnParams())  # type: ignore[arg-type]
    s, k = len(shots), len(ids)
    has, features, distances = np.zeros((s, k), bool), np.zeros((s, k, 1), np.float32), np.zeros((s, k, k), np.float32)
    for i, (own, values, between) in enumerate(shots):
        rows = np.searchsorted(ids, own)
        has[i, rows], features[i, rows, 0], distances[i][np.ix_(rows, rows)] = True, values, between
    return made.model_copy(
        update={
            "shots": [str(i) for i in range(s)],
            "ids": np.array(ids, np.int32),
            "has": has,
            "features": features,
            "distances": distances,
            **template,
        }
    )


def line(*places: float) -> np.ndarray:
    return np.abs(np.subtract.outer(places, places))


def test_averages_are_per_id_and_per_pair() -> None:
    template = combined(([7, 1], [2, 4], line(0, 0.5)), ([1, 3, 7], [6, 8, 4], line(0, 0.1, 0.3)))
    assert template.ids.tolist() == [1, 3, 7]
    assert template.counts.tolist() == [2, 1, 2]
    assert template.features[:, 0].tolist() == [5, 8, 3]
    assert np.allclose(template.distances, [[0, 0.1, 0.4], [0.1, 0, 0.2], [0.4, 0.2, 0]])


def test_unreachable_pairs_of_a_shot_are_not_observed() -> None:
    apart = line(0, 0.5)
    apart[0, 1] = apart[1, 0] = np.inf
    both = combined(([0, 1], [0, 0], apart), ([0, 1], [0, 0], line(0, 0.3)))
    assert both.distances[0, 1] == pytest.approx(0.3)
    assert not combined(([0, 1], [0, 0], apart)).mask.any()


def test_a_shot_that_counts_twice_is_as_good_as_two() -> None:
    one, other = ([7, 1], [2.0, 4.0], line(0, 0.5)), ([1, 3, 7], [6.0, 8.0, 4.0], line(0, 0.1, 0.3))
    for combine in ("mean", "sum_distances"):
        weighed, given = (
            combined(one, other, weights=[2, 1], combine=combine),
            combined(one, one, other, combine=combine),
        )
        for name in ("ids", "features", "distances", "mask", "counts", "of"):
            np.testing.assert_allclose(getattr(weighed, name), getattr(given, name), rtol=1e-6)
    assert combined(one, other, weights=[1, 0]).ids.tolist() == [1, 7], "ids of the shots that count"


def test_unreachable_pairs_of_the_target_count_as_its_largest_distance() -> None:
    points, features, distances = sphere(1)
    distances[:100, 100:] = distances[100:, :100] = np.inf
    target = (shape_of(points), features_of(features), distances_of(distances), keypoints_of([], [], points))
    found = solve(target, [labelled(0, IDS, AT)])
    assert np.isfinite(found.objective)


def test_smoothing_among_keypoints_mixes_near_ones_only() -> None:
    features = np.array([[0.0], [1.0], [5.0]], np.float32)
    assert np.allclose(smooth_among(features, line(0, 1e-6, 10), 0.1), [[0.5], [0.5], [5]], atol=1e-4)
    assert np.allclose(smooth_among(features, line(0, 1, 10), 0.01), features)


def test_feature_scales() -> None:
    features = np.random.default_rng(0).normal(3, 2, (500, 8))
    assert np.allclose(scale_features(features, "raw"), features, atol=1e-5)
    assert np.allclose(scale_features(features, "centred").mean(0), 0, atol=1e-5)
    assert np.allclose(np.linalg.norm(scale_features(features, "centred-unit"), axis=1), 1, atol=1e-5)
    standard = scale_features(features, "standardised")
    assert np.allclose(standard.std(0), 1 / np.sqrt(8), atol=1e-5)
    assert (standard**2).sum(1).mean() == pytest.approx(1, abs=1e-4)
    constant = np.ones((5, 3))
    for how in ("centred", "centred-unit", "standardised"):
        assert not scale_features(constant, how).any()  # type: ignore[arg-type]


def test_feature_statistics_come_from_observed_points() -> None:
    features = np.concatenate([np.random.default_rng(0).normal(size=(50, 4)), np.full((50, 4), 100.0)])
    observed = np.arange(100) < 50
    assert np.allclose(scale_features(features, "centred", observed)[:50].mean(0), 0, atol=1e-5)


def test_distance_scales() -> None:
    distances = line(0, 0.5, 2)
    distances[0, 2] = distances[2, 0] = np.inf
    for dtype in (np.float16, np.float64):
        found = relative_distances(distances.astype(dtype))
        assert found.relative[1, 2] == 1 and found.relative[0, 2] == 1 and found.largest == 1.5
        assert found.unreachable is not None and np.argwhere(found.unreachable).tolist() == [[0, 2], [2, 0]]
    nothing = relative_distances(-np.zeros((3, 3), np.float16))
    assert not nothing.relative.any() and nothing.unreachable is None


def test_retrieval_takes_the_shot_with_the_nearest_class_token() -> None:
    tokens = [np.eye(12)[0], np.eye(12)[1], 3 * np.eye(12)[1] + 0.3 * np.eye(12)[2]]
    shots = [labelled(i, [i, 8], AT[:2], token) for i, token in enumerate(tokens)]
    found = solve(labelled(5, [], [], np.eye(12)[1] + 0.1 * np.eye(12)[2]), shots, retrieval=True)
    assert found.shots == ["2"]
    assert found.ids.tolist() == [2, 8]


def test_retrieval_without_class_tokens_compares_mean_features() -> None:
    shots = [labelled(i, [i, 8], AT[:2]) for i in range(3)]
    means = np.random.default_rng(0).normal(0, 5, (3, 12))
    shots = [(one[0], features_of(one[1].features + mean), *one[2:]) for one, mean in zip(shots, means, strict=True)]
    points, features, distances = sphere(5)
    target = shape_of(points), features_of(features + 3 * means[2]), distances_of(distances), shots[0][3]
    assert solve(target, shots, retrieval=True).shots == ["2"]


def test_presence_by_majority() -> None:
    shots = [labelled(i, ids, AT[: len(ids)]) for i, ids in enumerate([[0, 1], [0, 2], [0, 1]])]
    assert solve(labelled(4, [], []), shots).present.all()
    assert solve(labelled(4, [], []), shots, presence="majority").present.tolist() == [True, True, False]


# what is wrong is said


def test_shots_without_common_ids() -> None:
    shots = [labelled(0, [0, 1], [3, 4]), labelled(2, [2, 3], [3, 4])]
    with pytest.raises(ValueError, match=r"an id that two of them share, got ids shot 0: \[0, 1\]; shot 1: \[2, 3\]"):
        solve(labelled(1, [], []), shots)


def test_shots_without_keypoints() -> None:
    with pytest.raises(ValueError, match="expected at least one keypoint, got none"):
        solve(labelled(1, [], []), [labelled(0, [], []), labelled(2, [], [])])


def test_one_shot_without_keypoints_among_others_is_no_error() -> None:
    assert (
        solve(labelled(1, [], []), [labelled(0, [], []), labelled(2, IDS, AT), labelled(3, IDS, AT)]).ids.tolist()
        == IDS
    )


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
