"""The trained head: it finds what can be told apart, is the same every time, judges presence on unseen shots, and runs
once a draw."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from b23d.pipeline.run import Run
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.head import KeypointHead
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.predictions import Prediction
from b23d.schemas.shape import NormalizedShape
from b23d.stages.apply_head import ApplyHeadParams, apply_head
from b23d.stages.heads.calibration import threshold
from b23d.stages.heads.choosing import choose
from b23d.stages.heads.detector import probabilities
from b23d.stages.heads.inputs import gaussian, shape_inputs
from b23d.stages.heads.training import principal
from b23d.stages.solvers.shots import described as whole
from b23d.stages.train_head import TrainHeadParams, train_head
from tests.made_features import apart, cloud, described, keypointed
from tests.made_params import placed

Shot = tuple[NormalizedShape, PointFeatures, GeodesicDistances, Keypoints]
IDS = [3, 5, 8]
SHARP = {"sigma": 0.01, "context": 0.0}


LINEAR: dict[str, Any] = {"detector": "linear"}


def shot(seed: int, ids: list[int] = IDS, n: int = 120, channels: int = 16) -> tuple[Shot, list[int]]:
    """Noise, and at each keypoint (a random candidate) a channel of its own that no other point has. Returns it and the
    candidates."""
    random = np.random.default_rng(seed)
    points = random.uniform(-0.5, 0.5, (n, 3))
    at = random.choice(n, len(ids), replace=False).tolist()
    features = 0.1 * random.normal(size=(n, channels))
    features[at] += 3 * np.eye(10, channels)[ids]
    return (cloud(points), described(features), apart(points), keypointed(points, ids, at)), at


def trained(shots: list[Shot], **params: Any) -> KeypointHead:
    columns = [list(column) for column in zip(*shots, strict=True)]
    return train_head(*columns, placed(TrainHeadParams, **SHARP | {"features": "raw"} | params))


def found(target: Shot, head: KeypointHead, **params: Any) -> Prediction:
    return apply_head(*target[:3], head, ApplyHeadParams(**params))


@pytest.mark.parametrize("layers", [LINEAR, {"detector": "hidden", "width": 16}], ids=["linear", "hidden"])
@pytest.mark.parametrize("features", ["raw", "centred", "centred-unit", "standardised"])
def test_keypoints_that_a_plane_separates_are_found_exactly(features: str, layers: dict[str, Any]) -> None:
    head = trained([shot(seed)[0] for seed in range(3)], features=features, absent="never", **layers)
    for seed in (0, 10, 11):
        target, at = shot(seed)
        prediction = found(target, head, separation=0)
        assert prediction.ids.tolist() == IDS
        assert prediction.points.tolist() == at
        assert np.array_equal(prediction.positions, target[0].points[at])
        assert prediction.present.all()
        assert prediction.costs.sum() == pytest.approx(prediction.objective, rel=1e-5)


def test_training_again_gives_the_same_head() -> None:
    shots = [shot(seed)[0] for seed in range(2)]
    hidden = {"detector": "hidden", "width": 8}
    for layers in (LINEAR, hidden):
        one, other = trained(shots, **layers), trained(shots, **layers)
        assert all(
            np.array_equal(a, other.present_arrays()[name], equal_nan=True) for name, a in one.present_arrays().items()
        )
    assert not np.array_equal(trained(shots, **hidden).weights, trained(shots, **hidden, seed=1).weights)


def test_order_of_candidates_and_shots_does_not_matter() -> None:
    shots = [shot(seed)[0] for seed in range(2)]
    (shape, features, distances, keypoints), _ = shot(10)
    order = np.random.default_rng(0).permutation(len(shape.points))
    shuffled = (cloud(shape.points[order]), described(features.features[order]), apart(shape.points[order]), keypoints)
    one = found((shape, features, distances, keypoints), trained(shots, context=0.1))
    other = found(shuffled, trained(shots[::-1], context=0.1))
    assert np.array_equal(one.positions, other.positions)
    assert np.allclose(one.costs, other.costs, atol=1e-3)


def test_an_id_that_the_target_lacks_is_judged_absent() -> None:
    """Shots that lack it have shown how little then answers."""
    shots = [shot(seed, ids)[0] for seed, ids in enumerate([IDS, IDS, [3, 8], [5, 8], [3, 5]])]
    head = trained(shots)
    assert 0 < head.threshold < 1
    assert np.isfinite(head.held_out).all()
    assert found(shot(10)[0], head).present.tolist() == [True, True, True]
    assert found(shot(11, [3, 8])[0], head).present.tolist() == [True, False, True]
    assert found(shot(11, [3, 8])[0], trained(shots, absent="never")).present.all()


def test_threshold_by_hand() -> None:
    peaks = np.array([[0.9, 0.8, 0.3], [0.95, 0.2, np.nan]])
    has = np.array([[True, True, False], [True, False, True]])
    assert threshold(peaks, has) == pytest.approx((0.3 + 0.8) / 2)
    assert threshold(peaks, np.ones((2, 3), bool)) == 0, "nothing is known to be absent"
    assert threshold(np.array([[0.2, 0.9]]), np.array([[True, False]])) == 0, "parting would gain nothing"
    assert threshold(np.array([[0.5, 0.5]]), np.array([[True, False]])) == 0, "equal peaks cannot be parted"
    assert threshold(np.full((1, 3), np.nan), np.ones((1, 3), bool)) == 0, "a single shot has no other to learn from"


def test_one_shot_has_nobody_to_be_tested_on() -> None:
    one, at = shot(0)
    head = trained([one])
    assert np.isnan(head.held_out).all()
    assert head.threshold == 0
    assert found(one, head).points.tolist() == at


def test_surer_ids_choose_first_and_keep_others_off() -> None:
    lengths = np.abs(np.subtract.outer(np.arange(5), np.arange(5))).astype(float)
    likely = np.array([[0.9, 0.7, 0.1], [0.8, 0.6, 0.1], [0.2, 0.5, 0.1], [0.1, 0.4, 0.2], [0.0, 0.1, 0.1]])
    assert choose(likely, lengths, 0).tolist() == [0, 0, 3]
    assert choose(likely, lengths, 1).tolist() == [0, 2, 4]
    assert choose(likely, lengths, 9).tolist() == [0, 0, 3], "with no place left, each keeps its best"


def test_a_neighbourhood_s_mean_follows_the_surface() -> None:
    (shape, features, distances, _), _ = shot(0)
    alone, lengths = shape_inputs(whole("it", shape, features, distances), "raw", 0)
    inputs, _ = shape_inputs(whole("it", shape, features, distances), "raw", 0.2)
    assert lengths.max() == 1
    weights = np.exp(-0.5 * (lengths.astype(float) / 0.2) ** 2)
    assert np.array_equal(inputs[:, :16], alone)
    assert np.allclose(inputs[:, 16:], weights @ alone / weights.sum(1, keepdims=True), atol=1e-5)
    cut = distances.distances.copy()
    cut[:60, 60:] = cut[60:, :60] = np.inf
    distances = distances.model_copy(update={"distances": cut})
    parted, lengths = shape_inputs(whole("it", shape, features, distances), "raw", 0.2)
    weights = np.exp(-0.5 * (lengths[:60, :60].astype(float) / 0.2) ** 2)
    assert np.allclose(parted[:60, 16:], weights @ alone[:60] / weights.sum(1, keepdims=True), atol=1e-5), (
        "nothing from beyond a gap"
    )
    assert gaussian(np.array([0, np.inf]), 0.1).tolist() == [1, 0]


def test_folding_the_principal_components_in_changes_nothing() -> None:
    random = np.random.default_rng(0)
    rows = random.normal(size=(50, 6)) @ random.normal(size=(6, 6))
    basis = principal(rows, 6)
    assert np.allclose(np.linalg.svd(basis, compute_uv=False), np.linalg.norm(basis[:, 0]), rtol=1e-4), (
        "an orthogonal basis, scaled"
    )
    assert (rows @ basis)[:, 0].std() == pytest.approx(1, rel=0.1)
    assert principal(rows, 2).shape == (6, 2)
    head = trained([shot(0)[0], shot(1)[0]], components=4)
    assert head.weights.shape == (16, 3), "in the inputs' own coordinates"
    assert probabilities(head, np.zeros((5, 16), np.float32)).shape == (5, 3)


def test_a_run_trains_once_a_draw(tmp_path: Path) -> None:
    """All targets of a draw share one head: its address depends on the shots alone."""
    overrides = [
        "dataset.count=5",
        "shots.draws=[0, 1]",
        'dataset.classes=["chair", "mug"]',
        f'store.root="{tmp_path}"',
    ]
    run = Run.load(Path(__file__).parents[1] / "runs" / "head.toml", overrides)
    plan = run.plan()
    counts = {stage: sum(states.values()) for stage, states in plan.count().items()}
    assert (counts["train_head"], counts["apply_head"], counts["score"]) == (2 * 2, 2 * 2 * 2, 2 * 2 * 2)
    assert "optimize" not in counts
    for draw in plan.draws:
        heads = {plan.by_shape["train_head", target.name, draw.seed].address for target in draw.targets}
        assert len(heads) == 1


def test_what_does_not_fit_is_named() -> None:
    (shape, features, distances, keypoints), _ = shot(0)
    head = trained([(shape, features, distances, keypoints)])
    with pytest.raises(ValueError, match=r"features: expected inputs of 16 numbers as the head has .* got 5"):
        found((shape, described(features.features[:, :5]), distances, keypoints), head)
    with pytest.raises(
        ValueError, match="the target: expected features and distances of its 120 candidates, got 7 and 120"
    ):
        found((shape, described(features.features[:7]), distances, keypoints), head)
    with pytest.raises(ValueError, match="shots: expected at least one keypoint, got none"):
        trained([(shape, features, distances, keypointed(shape.points, [], []))])
    with pytest.raises(ValueError, match="shots: expected features with as many channels"):
        trained([(shape, features, distances, keypoints), shot(1, channels=12)[0]])
    with pytest.raises(ValueError, match="shot 0: expected finite features"):
        trained([(shape, described(np.full((120, 16), np.nan)), distances, keypoints)])
