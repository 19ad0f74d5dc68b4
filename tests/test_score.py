"""Scores: identities, counts by hand, symmetries, and the table."""

from __future__ import annotations

import json

import numpy as np
import pytest
from pydantic import ValidationError

from b23d.schemas.keypoints import Keypoints
from b23d.schemas.predictions import Prediction
from b23d.schemas.scores import ScoreTable, ShapeScore
from b23d.schemas.shape import NormalizedShape
from b23d.stages.score import ScoreParams, score
from b23d.stages.scoring.distances import keypoint_distances
from b23d.stages.scoring.iou import count, within
from b23d.stages.scoring.matching import labelled, matched
from b23d.stages.scoring.summary import score_table
from b23d.stages.scoring.table import render

SCALE = 2.0


def line_shape(n: int = 101, candidates: str = "cloud") -> NormalizedShape:
    """n points in a row, .01 apart in the unit frame, .02 apart in the data set's units."""
    points = np.zeros((n, 3), np.float32)
    points[:, 0] = np.arange(n) / 100 - 0.5
    return NormalizedShape(
        kind="cloud",
        vertices=points,
        faces=np.zeros((0, 3), np.int32),
        points=points,
        point_faces=np.full(n, -1, np.int32),
        point_barycentrics=np.zeros((n, 3), np.float32),
        candidates=candidates,
        center=(1.0, 0.0, 0.0),
        scale=SCALE,
        repairs={},
    )


def annotated(ids: list[int], indices: list[int], **lists: list[tuple[int, ...]]) -> Keypoints:
    positions = np.zeros((len(ids), 3))
    positions[:, 0] = (np.array(indices) / 100 - 0.5) * SCALE + 1
    names, at = np.array(ids, np.int32), np.array(indices, np.int32)
    return Keypoints(ids=names, positions=positions, point_indices=at, annotation_file="abc", **lists)


def predicted(ids: list[int], points: list[int], present: list[bool] | None = None) -> Prediction:
    k = len(ids)
    return Prediction(
        ids=np.array(ids, np.int32),
        points=np.array(points, np.int32),
        positions=line_shape().points[points].reshape(-1, 3),
        present=np.array([True] * k if present is None else present, bool),
        costs=np.zeros(k, np.float32),
        objective=0.0,
        method="test",
    )


def scored(
    prediction: Prediction, truth: Keypoints, shots: list[Keypoints] | None = None, **params: object
) -> ShapeScore:
    return score(line_shape(), prediction, truth, shots if shots is not None else [truth], ScoreParams(**params))


def iou(one: ShapeScore) -> np.ndarray:
    return one.true_positives / (one.true_positives + one.false_positives + one.false_negatives)


def test_the_truth_scores_one_everywhere_even_at_zero() -> None:
    truth = annotated([4, 1, 9], [0, 40, 80])
    one = scored(predicted([9, 4, 1], [80, 0, 40]), truth)  # in any order
    assert one.thresholds.tolist() == [0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09, 0.1]
    assert (iou(one) == 1).all()
    for counts in (one.true_positives, one.matched, one.labelled, one.symmetric):
        assert (counts == 3).all()
    assert (one.annotated, one.predicted, one.common) == (3, 3, 3)
    assert one.ceiling.tolist() == [3, 3]
    assert one.annotation_file == "abc"


def test_distances_run_along_the_cloud_in_the_data_sets_units() -> None:
    prediction, truth = predicted([0, 1], [3, 50]), annotated([0, 1], [0, 52])
    one = scored(prediction, truth, thresholds=(0, 0.03, 0.05, 0.07))
    assert np.allclose(one.distances, [[0.06, 0.98], [1.0, 0.04]], atol=1e-6)
    assert one.true_positives.tolist() == [0, 0, 1, 2]
    unit = scored(prediction, truth, units="unit")
    assert np.allclose(unit.distances, one.distances / SCALE, atol=1e-6)


def test_geodesic_is_not_the_straight_line() -> None:
    angles = np.linspace(0, np.pi, 400)
    arc = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles]) / 2
    shape = line_shape(400).model_copy(update={"points": arc.astype(np.float32)})
    truth = Keypoints(ids=np.zeros(1, np.int32), positions=arc[:1] * SCALE, point_indices=np.zeros(1, np.int32))
    assert keypoint_distances(shape, np.array([399]), truth)[0, 0] == pytest.approx(np.pi / 2 * SCALE, rel=0.01)


def test_counts_by_hand() -> None:
    # prediction 0 meets keypoints 0 and 1, prediction 1 meets none, keypoint 2 is met by none
    hits = within(np.array([[0.01, 0.02, 0.5], [0.5, 0.5, 0.06]]), np.array([0.05, 0.06]), "<=")
    counts = count(hits)
    assert counts.true_positives.tolist() == [2, 3]
    assert counts.false_positives.tolist() == [1, 0]
    assert counts.false_negatives.tolist() == [1, 0]
    assert matched(hits).tolist() == [1, 2]


def test_counts_are_those_of_the_protocol_s_formula() -> None:
    """KeypointNet's IoU is (annotated − missed) / (annotated + wrong)."""
    random = np.random.default_rng(0)
    distances, thresholds = random.uniform(size=(7, 9)), np.linspace(0, 1, 11)
    counts = count(within(distances, thresholds, "<="))
    for t, threshold in enumerate(thresholds):
        missed, wrong = (distances.min(0) > threshold).sum(), (distances.min(1) > threshold).sum()
        expected = (9 - missed) / (9 + wrong)
        parts = counts.true_positives[t], counts.false_positives[t], counts.false_negatives[t]
        assert parts[0] / sum(parts) == pytest.approx(expected)
    assert (np.diff(counts.true_positives) >= 0).all()


def test_one_prediction_for_two_keypoints_is_one_match() -> None:
    one = scored(predicted([0], [50]), annotated([0, 1], [49, 51]))
    assert one.true_positives[-1] == 2
    assert one.matched[-1] == 1
    assert one.labelled[-1] == 1


def test_matching_is_maximum_not_greedy() -> None:
    hits = np.array([[[True, True], [True, False]]])
    assert matched(hits).tolist() == [2]


def test_wrong_names_count_in_iou_but_not_in_pck() -> None:
    one = scored(predicted([0, 1], [80, 0]), annotated([0, 1], [0, 80]))
    assert (iou(one) == 1).all()
    assert (one.labelled == 0).all()


def test_detectors_know_no_names() -> None:
    one = scored(predicted([-1, -1], [0, 80]), annotated([0, 1], [0, 80]))
    assert (iou(one) == 1).all()
    assert (one.labelled == 0).all()
    assert one.common == 0
    assert labelled(np.ones((1, 1, 1), bool), np.array([-1]), np.array([-1])).tolist() == [0]


def test_absent_predictions_do_not_count() -> None:
    truth = annotated([0, 1], [0, 80])
    one = scored(predicted([0, 1, 2], [0, 80, 40], [True, True, False]), truth)
    assert (iou(one) == 1).all()
    assert one.predicted == 2
    assert one.distances.shape == (2, 2)


def test_nothing_predicted_or_nothing_annotated() -> None:
    none = scored(predicted([0], [0], [False]), annotated([0, 1], [0, 80]))
    assert (none.true_positives == 0).all()
    assert (none.false_negatives == 2).all()
    assert (none.matched == 0).all()
    empty = scored(predicted([0], [0]), annotated([], []))
    assert (empty.false_positives == 1).all()


def test_ceiling_and_presence() -> None:
    truth = annotated([0, 1, 5], [0, 40, 80])
    one = scored(predicted([0, 1, 2], [0, 40, 50]), truth, [annotated([0, 1], [0, 40]), annotated([1, 2], [40, 50])])
    assert one.ceiling.tolist() == [2, 4]
    assert one.common == 2


def test_keypoints_off_the_candidates_become_nodes() -> None:
    truth = annotated([0, 1, 2], [10, 50, 50])
    aside = truth.positions + np.array([0.005, 0, 0])
    off = truth.model_copy(update={"positions": aside, "point_indices": np.full(3, -1, np.int32)})
    shape = line_shape(candidates="fps")
    assert np.allclose(
        keypoint_distances(shape, np.array([10, 50]), off), [[0.005, 0.805, 0.805], [0.795, 0.005, 0.005]], atol=1e-6
    )
    on = keypoint_distances(shape, np.array([10, 50]), truth)
    assert (on[[0, 1], [0, 1]] == 0).all()


def test_parts_that_no_path_joins_are_missed() -> None:
    points = line_shape(60).points.copy()
    points[30:, 1] += 50
    shape = line_shape(60).model_copy(update={"points": points})
    truth = annotated([0, 1], [0, 40])
    far = keypoint_distances(shape, np.array([0]), truth)
    assert far[0].tolist() == [0, np.inf]


# the table


def test_iou_is_summed_over_a_class_then_averaged_over_draws() -> None:
    truth = annotated([0, 1, 2], [0, 40, 80])
    good, poor = scored(predicted([0, 1, 2], [0, 40, 80]), truth), scored(predicted([0], [20]), truth)
    rows = [
        ("a", 0, "a/1", good),
        ("a", 0, "a/2", poor),
        ("a", 1, "a/1", good),
        ("b", 0, "b/1", poor),
        ("b", 1, "b/1", good),
    ]
    table = score_table("r", "p", rows)
    a, b = table.classes["a"], table.classes["b"]
    assert a.iou.mean[0] == pytest.approx((3 / 7 + 1) / 2)  # draw 0: TP 3, FP 1, FN 3
    assert a.iou.sd[0] == pytest.approx(np.std([3 / 7, 1], ddof=1))
    assert (a.targets, b.targets, table.mean.targets) == (2, 1, 3)
    assert (a.draws, table.mean.draws) == (2, 2)
    assert b.auc.mean == pytest.approx(0.5)
    assert table.mean.iou.mean[0] == pytest.approx(((3 / 7 + 0) / 2 + 1) / 2)
    assert table.mean.iou.sd[0] == pytest.approx(np.std([3 / 14, 1], ddof=1))
    assert a.presence.precision.mean == 1
    assert a.presence.recall.mean == pytest.approx((4 / 6 + 1) / 2)
    assert a.ceiling == 1
    assert a.one_to_one.mean[0] == pytest.approx((3 / 7 + 1) / 2)
    assert a.annotation_files == ["abc"]


def test_one_draw_has_no_spread_and_classes_are_sorted() -> None:
    truth = annotated([0], [0])
    one = scored(predicted([0], [0]), truth)
    table = score_table("r", None, [("b", 0, "b/1", one), ("a", 0, "a/1", one)])
    assert list(table.classes) == ["a", "b"]
    assert table.mean.auc.sd == 0
    assert table.protocol == "<= threshold along the 20-NN graph, data set's units, candidates cloud"


def test_draws_that_a_class_lacks_stay_out_of_the_mean() -> None:
    truth = annotated([0], [0])
    good, poor = scored(predicted([0], [0]), truth), scored(predicted([0], [90]), truth)
    table = score_table("r", "p", [("a", 0, "a/1", good), ("a", 1, "a/1", poor), ("b", 0, "b/1", good)])
    assert table.mean.draws == 1
    assert table.mean.auc.mean == 1
    apart = score_table("r", "p", [("a", 1, "a/1", poor), ("b", 0, "b/1", good)])
    assert apart.mean.auc.mean == pytest.approx(0.5)


def test_json_has_the_keys_of_the_command() -> None:
    truth = annotated([0], [0])
    table = score_table("r", "p", [("a", 0, "a/1", scored(predicted([0], [0]), truth))])
    printed = json.loads(table.model_dump_json())
    assert printed.keys() == {"run", "protocol", "classes", "mean"}
    for scores in (printed["classes"]["a"], printed["mean"]):
        assert scores.keys() >= {"targets", "thresholds", "iou", "auc", "pck", "ceiling"}
        assert len(scores["iou"]["mean"]) == len(scores["iou"]["sd"]) == len(scores["thresholds"]) == 11
        assert scores["auc"].keys() == {"mean", "sd"}
        assert len(scores["pck"]["mean"]) == 11
        assert isinstance(scores["ceiling"], float)
    assert ScoreTable.model_validate(printed) == table


def test_no_scores_or_unlike_ones_are_errors() -> None:
    with pytest.raises(ValueError, match="scores of r: expected at least one scored shape"):
        score_table("r", "p", [])
    truth = annotated([0], [0])
    rows = [("a", 0, f"a/{t}", scored(predicted([0], [0]), truth, thresholds=(t,))) for t in (0.1, 0.2)]
    with pytest.raises(ValueError, match="expected the same thresholds"):
        score_table("r", "p", rows)
    with pytest.raises(ValidationError):
        ScoreParams(thresholds=(-0.1,))


def test_one_draw_is_told_without_a_spread() -> None:
    truth = annotated([0, 1, 2], [0, 40, 80])
    rows = [("a", draw, "a/1", scored(predicted([0, 1, 2], [0, 40, 80]), truth)) for draw in (0, 1)]
    one, two = render(score_table("r", "p", rows[:1])).caption, render(score_table("r", "p", rows)).caption
    assert "1 draw of shots" in str(one) and "±" not in str(one)
    assert "mean ± sd over 2 draws of shots" in str(two)


def test_table_is_readable() -> None:
    from rich.console import Console

    truth = annotated([0, 1, 2], [0, 40, 80])
    good, poor = scored(predicted([0, 1, 2], [0, 40, 80]), truth), scored(predicted([0], [20]), truth)
    rows = [("a", 0, "a/1", good), ("a", 1, "a/1", poor), ("b", 0, "b/1", good), ("b", 1, "b/1", good)]
    console = Console(width=160, record=True, file=open("/dev/null", "w"))  # noqa: SIM115, PTH123
    console.print(render(score_table("name", "p", rows)))
    text = console.export_text()
    for part in ("name", "IoU 0.02", "IoU 0.1", "AUC", "PCK 0.1", "ceiling", ".500 ±.707", "1.000 ±.000", "mean"):
        assert part in text
