"""What the shots ask for: averages an id and a pair, over the shots that count."""

from __future__ import annotations

import numpy as np
import pytest

from b23d.stages.solvers.template import smooth_among
from tests.made_spheres import AT, IDS, distances_of, features_of, labelled, shape_of, solve, sphere
from tests.made_templates import combined, line


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


def test_smoothing_among_keypoints_mixes_near_ones_only() -> None:
    features = np.array([[0.0], [1.0], [5.0]], np.float32)
    assert np.allclose(smooth_among(features, line(0, 1e-6, 10), 0.1), [[0.5], [0.5], [5]], atol=1e-4)
    assert np.allclose(smooth_among(features, line(0, 1, 10), 0.01), features)


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
