"""Part labels: a shape's own are found again, an oracle for the vote, ShapeNetPart's IoU by hand, the table."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from b23d.pipeline.planning.nodes import State
from b23d.pipeline.run import Run
from b23d.schemas.parts import Parts
from b23d.schemas.predictions import PartPrediction
from b23d.schemas.scores import PartScore, PartTable
from b23d.stages.score_parts import PartScoreParams, score_parts
from b23d.stages.scoring.parts import part_table, render
from b23d.stages.solvers.voting import vote
from b23d.stages.transfer import TransferParams, transfer
from tests.made_features import cloud, described, labelled
from tests.small_runs import FAST

NAMES = ["seat", "leg", "back", "arm"]
RUN = (
    """
name = "parts"
outputs = ["score_parts"]
[dataset]
kind = "shapenetpart"
root = "data"
[shots]
count = 1
draws = [0]
[store]
root = "{store}"
"""
    + FAST
)


def random_shape(seed: int, n: int = 150, channels: int = 24) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, features that tell one of three parts (with noise), labels."""
    random = np.random.default_rng(seed)
    labels = random.integers(0, 3, n)
    means = np.random.default_rng(99).normal(size=(3, channels))
    return random.uniform(-0.5, 0.5, (n, 3)), means[labels] + 0.3 * random.normal(size=(n, channels)), labels


def carried(target: np.ndarray, shots: list[int], points: np.ndarray | None = None, **params: Any) -> PartPrediction:
    made = [random_shape(seed) for seed in shots]
    points = np.random.default_rng(0).normal(size=(len(target), 3)) if points is None else points
    return transfer(
        cloud(points),
        described(target),
        [cloud(p) for p, _, _ in made],
        [described(f) for _, f, _ in made],
        [labelled(p, labels, NAMES) for p, _, labels in made],
        TransferParams(**params),
    )


@pytest.mark.parametrize("features", ["raw", "centred", "centred-unit", "standardised"])
def test_a_shape_gets_its_own_labels_back(features: str) -> None:
    points, own, labels = random_shape(0)
    found = carried(own, [0], points, k=1, features=features)
    assert np.array_equal(found.labels, labels)
    assert (found.confidence == 1).all()
    scored = score_parts(cloud(points), found, labelled(points, labels, NAMES), PartScoreParams())
    assert scored.iou == 1
    assert scored.present.tolist() == [True, True, True, False]


def test_several_shots_and_neighbours_agree_on_separable_parts() -> None:
    points, own, labels = random_shape(7)
    found = carried(own, [0, 1, 2], points, k=9)
    assert np.array_equal(found.labels, labels)
    assert found.names == NAMES


def test_order_of_candidates_and_of_shots_does_not_matter() -> None:
    points, own, _ = random_shape(7)
    noisy = own + 2 * np.random.default_rng(1).normal(size=own.shape)
    order = np.random.default_rng(2).permutation(len(own))
    plain, shuffled = carried(noisy, [0, 1], points), carried(noisy[order], [1, 0], points[order])
    assert np.array_equal(plain.labels[order], shuffled.labels)
    assert np.allclose(plain.confidence[order], shuffled.confidence, atol=1e-5)


@pytest.mark.parametrize("weighting", ["similarity", "uniform"])
@pytest.mark.parametrize("k", [1, 4, 500])
def test_the_vote_is_that_of_a_plain_loop(weighting: Any, k: int) -> None:
    random = np.random.default_rng(k)
    target, known = (
        rows / np.linalg.norm(rows, axis=1, keepdims=True) for rows in np.split(random.normal(size=(80, 6)), [20])
    )
    labels = random.integers(0, 4, 60)
    found, share = vote(target, known, labels, 5, k, weighting)
    for i in range(20):
        cosines = known @ target[i]
        sums = np.zeros(5)
        for j in np.argsort(-cosines)[:k]:
            sums[labels[j]] += 1 + cosines[j] if weighting == "similarity" else 1
        assert found[i] == sums.argmax()
        assert share[i] == pytest.approx(sums.max() / sums.sum())


def test_a_shot_s_candidates_take_the_nearest_annotated_point() -> None:
    points = np.array([[0.0, 0, 0], [0.4, 0, 0]])
    annotated = labelled(np.array([[0.05, 0, 0], [0.3, 0, 0], [0.39, 0, 0]]), np.array([2, 0, 1]), NAMES)
    features = described(np.eye(2))
    found = transfer(cloud(points), features, [cloud(points)], [features], [annotated], TransferParams(k=1))
    assert found.labels.tolist() == [2, 1]


def test_what_does_not_fit_is_named() -> None:
    points, own, labels = random_shape(0)
    shape, features, parts = cloud(points), described(own), labelled(points, labels, NAMES)
    with pytest.raises(ValueError, match="expected the same names in every shape"):
        other = parts.model_copy(update={"names": ["a", "b", "c"]})
        transfer(shape, features, [shape] * 2, [features] * 2, [parts, other], TransferParams())
    with pytest.raises(ValueError, match="shot 0: expected points with part labels, got none"):
        empty = Parts(points=np.zeros((0, 3)), labels=np.zeros(0, np.int32), names=NAMES)
        transfer(shape, features, [shape], [features], [empty], TransferParams())
    with pytest.raises(ValueError, match="shot 0: expected part labels below 2"):
        transfer(
            shape, features, [shape], [features], [parts.model_copy(update={"names": ["a", "b"]})], TransferParams()
        )
    with pytest.raises(ValueError, match="expected as many channels"):
        transfer(shape, described(own[:, :5]), [shape], [features], [parts], TransferParams())
    with pytest.raises(ValueError, match="the target: expected features of its 150 candidates, got 3"):
        transfer(shape, described(own[:3]), [shape], [features], [parts], TransferParams())


# scores


def scored(predicted: list[int], annotated: list[int], **params: Any) -> PartScore:
    points = np.zeros((len(annotated), 3))
    points[:, 0] = np.arange(len(annotated)) / 10
    labels = np.array(predicted, np.int32)
    prediction = PartPrediction(labels=labels, confidence=np.ones(len(labels), np.float32), names=NAMES, method="test")
    return score_parts(
        cloud(points), prediction, labelled(points, np.array(annotated), NAMES), PartScoreParams(**params)
    )


def test_iou_by_hand() -> None:
    one = scored([0, 0, 1, 2], [0, 0, 0, 1])
    assert one.intersection.tolist() == [2, 0, 0, 0]
    assert one.union.tolist() == [3, 2, 1, 0]
    assert one.present.tolist() == [True, True, False, False]
    assert one.iou == pytest.approx((2 / 3 + 0 + 0 + 1) / 4), (
        "an absent part that is not predicted counts 1, one that is 0"
    )
    assert scored([0, 0, 1, 2], [0, 0, 0, 1], absent="skip").iou == pytest.approx((2 / 3) / 3)


def test_annotated_points_take_the_nearest_candidate_s_label() -> None:
    prediction = PartPrediction(
        labels=np.array([0, 1], np.int32), confidence=np.ones(2, np.float32), names=NAMES, method="test"
    )
    annotated = labelled(np.array([[0.1, 0, 0], [0.2, 0, 0], [0.9, 0, 0]]), np.array([0, 1, 1]), NAMES)
    one = score_parts(cloud(np.array([[0.0, 0, 0], [1.0, 0, 0]])), prediction, annotated, PartScoreParams())
    assert one.intersection.tolist() == [1, 1, 0, 0]
    assert one.union.tolist() == [2, 2, 0, 0]


def test_the_table_averages_over_shapes_then_classes_then_draws() -> None:
    good, half = scored([0, 1], [0, 1]), scored([1, 1], [0, 1])  # 1 and (0 + 1/2 + 1 + 1) / 4
    assert half.iou == 0.625
    rows = [("a", 0, "1", good), ("a", 0, "2", half), ("a", 1, "1", good), ("b", 0, "1", half), ("b", 1, "1", half)]
    table = part_table("r", rows)
    assert table.classes["a"].iou.mean == pytest.approx((0.8125 + 1) / 2)
    assert table.classes["a"].iou.sd == pytest.approx(np.std([0.8125, 1], ddof=1))
    assert (table.classes["a"].targets, table.classes["a"].draws) == (2, 2)
    assert table.mean.mean == pytest.approx(((0.8125 + 0.625) / 2 + (1 + 0.625) / 2) / 2)
    assert table.instances.mean == pytest.approx(((1 + 0.625 + 0.625) / 3 + (1 + 0.625) / 2) / 2)
    assert table.classes["b"].parts == {"seat": 0.0, "leg": 0.5, "back": None, "arm": None}
    assert PartTable.model_validate(json.loads(table.model_dump_json())) == table
    with pytest.raises(ValueError, match="expected scored shapes of one protocol, got none"):
        part_table("r", [])


def test_the_table_is_readable() -> None:
    from rich.console import Console

    console = Console(width=140, record=True, quiet=False, file=open("/dev/null", "w"))  # noqa: SIM115, PTH123
    console.print(render(part_table("chairs", [("a", 0, "1", scored([1, 1], [0, 1]))])))
    text = console.export_text()
    for part in ("chairs", "62.5", "leg 50.0", "back –", "mean over classes", "mean over shapes"):
        assert part in text


@pytest.mark.slow
def test_a_run_on_shapes_with_parts_only(tmp_path: Path) -> None:
    """Drawn, transferred, scored and printed, without a keypoint anywhere."""
    from b23d.stages.workbench.results.scores import run_parts
    from tests.test_shapenetpart import make_shapenetpart

    make_shapenetpart(tmp_path / "data", 2)
    (tmp_path / "parts.toml").write_text(RUN.format(store=tmp_path / "store"))
    run = Run.load(tmp_path / "parts.toml")
    assert run.execute(workers=0).ok
    assert run.plan().count()["score_parts"][State.CACHED] == 2, "two classes of two, one of each the shot"
    table = run_parts(run)
    assert list(table.classes) == ["Laptop", "Mug"]
    assert 0 < table.mean.mean <= 1
