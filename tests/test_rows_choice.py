"""The rows of the table of differences on shots, solvers and scores, each on a case made to show it.

`test_rows.py` has the table.
"""

from __future__ import annotations

import numpy as np
import pytest

from b23d.pipeline.dataset import Leaf, Shape
from b23d.pipeline.planning.draws import draw_shots
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.runfile import Shots
from tests.made_spheres import AT, IDS, distances_of, features_of, labelled, shape_of, solve, sphere
from tests.made_templates import combined, line
from tests.test_posterior import Parts, box_cloud
from tests.test_posterior import run as posterior
from tests.test_score import SCALE, annotated, iou, line_shape, predicted, scored


def test_row_01_summed_distances_ask_for_a_larger_shape() -> None:
    """The shot itself, given twice: its mean is met exactly, its sum is twice as large as anything there."""
    twice = [labelled(0, IDS, AT)] * 2
    mean, total = (solve(twice[0], twice, combine=how, alpha=1) for how in ("mean", "sum_distances"))
    assert mean.objective == pytest.approx(0, abs=1e-3)
    assert total.objective > 0.5
    shots = ([0, 1, 2], [1.0, 2.0, 3.0], line(0, 0.2, 0.5)), ([0, 1, 2], [3.0, 2.0, 1.0], line(0, 0.4, 0.6))
    averaged, summed = combined(*shots), combined(*shots, combine="sum_distances")
    assert np.allclose(summed.distances, 2 * averaged.distances)
    assert np.array_equal(summed.features, averaged.features)  # features are averaged either way


def test_row_07_keypoints_smoothed_among_themselves_lose_their_own_features() -> None:
    own = labelled(0, [0, 1, 2, 3], AT)
    cloud, keypoints = (
        solve(own, [own], source_features=source, source_sigma=0.5) for source in ("cloud", "keypoints")
    )
    assert (cloud.points.tolist(), cloud.objective) == (AT, pytest.approx(0, abs=1e-3))
    assert keypoints.objective > 0.1


def test_row_09_scores_are_in_the_data_sets_units_and_the_loss_in_the_shapes() -> None:
    prediction, truth = predicted([0], [3]), annotated([0], [0])  # .03 apart in the unit frame
    dataset, unit = (scored(prediction, truth, units=units) for units in ("dataset", "unit"))
    assert dataset.distances[0, 0] == pytest.approx(SCALE * unit.distances[0, 0])
    assert (dataset.true_positives[5], unit.true_positives[5]) == (0, 1)  # .06 and .03 against .05
    points, features, apart = sphere(1)
    shots = [labelled(0, IDS, AT)]
    whole, half = ((shape_of(points), features_of(features), distances_of(d), shots[0][3]) for d in (apart, apart / 2))
    assert solve(whole, shots).objective == pytest.approx(solve(half, shots).objective, rel=1e-3)
    assert (
        solve(whole, shots, distances="unit-frame").objective
        < 0.9 * solve(half, shots, distances="unit-frame").objective
    )


def test_row_10_masks_differ_on_coincident_pairs_and_on_the_diagonal() -> None:
    shots = ([0, 1, 2], [0.0, 0.0, 0.0], line(0, 0, 0.5)), ([0, 3], [0.0, 0.0], line(0, 0.4))
    masks = {mask: combined(*shots, mask=mask).mask for mask in ("pairs", "positive", "whole")}
    for mask in masks.values():
        assert mask[0, 2] and mask[0, 3] and not mask[1, 3]  # 1 and 3 were never seen together
    assert [bool(masks[m][0, 1]) for m in ("pairs", "positive", "whole")] == [True, False, True]  # coincide
    assert [bool(masks[m][0, 0]) for m in ("pairs", "positive", "whole")] == [False, False, True]
    # Two ids at one place: only where that counts must they stay together on a target whose features would part them.
    one = labelled(0, [0, 1, 2], [3, 3, 50])
    features = one[1].features.astype(float)
    features[[7, 8]] = features[3]
    target = (one[0], features_of(features), one[2], one[3])
    together, free = (solve(target, [one], mask=mask).points for mask in ("pairs", "positive"))
    assert together[0] == together[1] == 3
    assert set(free[:2]) <= {3, 7, 8}


def test_row_11_the_papers_optimiser_is_seeded_and_the_discrete_one_reaches_lower() -> None:
    target, shots = labelled(1, [], []), [labelled(0, IDS, AT), labelled(2, IDS, AT)]
    once, again, other = (solve(target, shots, method="softmax", alpha=1, steps=30, seed=seed) for seed in (0, 0, 1))
    assert np.array_equal(once.points, again.points)
    assert not np.array_equal(once.points, other.points)
    longer = solve(target, shots, method="softmax", alpha=1, steps=200)
    slower = solve(target, shots, method="softmax", alpha=1, steps=30, learning_rate=1e-3)
    assert len({tuple(found.points) for found in (once, longer, slower)}) == 3
    discrete = solve(target, shots, alpha=1)
    assert discrete.objective <= min(found.objective for found in (once, other, longer, slower))


def test_row_13_within_includes_the_threshold_unless_told() -> None:
    truth, prediction = annotated([0], [0]), predicted([0], [0])
    assert scored(prediction, truth, inside="<=").true_positives[0] == 1
    strict = scored(prediction, truth, inside="<").true_positives
    assert strict[0] == 0
    assert (strict[1:] == 1).all()


def test_row_14_one_prediction_accounts_for_several_keypoints_or_for_one() -> None:
    prediction, truth = predicted([0], [50]), annotated([0, 1], [49, 51])
    many, one = (scored(prediction, truth, iou=kind) for kind in ("many-to-one", "one-to-one"))
    assert iou(many)[-1] == 1
    assert iou(one)[-1] == 0.5
    assert (one.true_positives[-1], one.false_positives[-1], one.false_negatives[-1]) == (1, 0, 1)
    assert one.protocol == f"one-to-one, {many.protocol}"
    assert (many.matched == one.matched).all()  # shown beside it, whichever is chosen


def _shapes() -> list[Shape]:
    leaf = Leaf(lambda files, values: line_shape())
    return [Shape(f"{i:02}", "c", {"keypoints": leaf}, official=["train", "test", "val"][i % 3]) for i in range(30)]


def test_row_15_targets_are_all_but_the_shots_or_the_official_test_split() -> None:
    rest, official = (
        draw_shots(_shapes(), Shots(draws=[0], split=split), (), {"keypoints"})[0]
        for split in ("all-but-shots", "official")
    )
    assert len(rest.targets) == 27
    assert {s.official for s in rest.targets} == {"train", "test", "val"}
    assert ({s.official for s in official.shots}, {s.official for s in official.targets}) == ({"train"}, {"test"})
    assert len(official.targets) == 10


def test_row_16_shots_are_seeded_draws_or_fixed() -> None:
    drawn = draw_shots(_shapes(), Shots(), (), {"keypoints"})
    assert [d.seed for d in drawn] == [0, 1, 2, 3, 4]
    assert len({tuple(s.id for s in d.shots) for d in drawn}) == 5
    assert [[s.id for s in d.shots] for d in drawn] == [
        [s.id for s in d.shots] for d in draw_shots(_shapes(), Shots(), (), {"keypoints"})
    ]
    (fixed,) = draw_shots(_shapes(), Shots(ids={"c": ["00", "01", "02"]}), (), {"keypoints"})
    assert [s.id for s in fixed.shots] == ["00", "01", "02"]


def test_row_17_the_published_assignment_loses_its_labels() -> None:
    own = labelled(0, IDS, [180, 3, 120, 50])
    kept, lost = (solve(own, [own], method="hungarian", assignment=order) for order in ("labelled", "sorted"))
    assert kept.points.tolist() == [180, 3, 120, 50]
    assert lost.points.tolist() == [3, 50, 120, 180]


def _with_knob(seed: int, knob: bool) -> Parts:
    """A box; with a knob somewhere on its top, the points there look like nothing else, and one of them is keypoint
    8."""
    made, described, geodesic, keypoints = box_cloud(seed)
    place = np.array([np.random.default_rng(seed + 50).uniform(-0.3, 0.3), made.points[:, 1].max(), 0])
    away = np.linalg.norm(made.points - place, axis=1)
    features = described.features.copy()
    if knob:
        features[away < 0.08] = np.random.default_rng(5).normal(0, 3, features.shape[1])
        at = np.r_[keypoints.point_indices, away.argmin()].astype(np.int32)
        keypoints = Keypoints(
            ids=np.arange(9, dtype=np.int32), positions=made.points[at].astype(float), point_indices=at
        )
    return made, described.model_copy(update={"features": features}), geodesic, keypoints


@pytest.mark.parametrize("target", range(5, 11))
def test_row_22_an_absent_keypoint_is_predicted_or_rejected_by_the_evidence(target: int) -> None:
    shots = [_with_knob(0, True), _with_knob(1, True), _with_knob(2, False)]

    def present(rule: str, knob: bool) -> list[bool]:
        return posterior(_with_knob(target, knob), shots, presence=rule).present.tolist()

    assert present("all", False) == [True] * 9
    assert present("majority", False) == [True] * 9  # two of three shots have it
    assert present("evidence", True) == [True] * 9
    assert present("evidence", False) == [True] * 8 + [False]
