"""Confidence means what it says: the map from what a method says to a probability, and how that is judged."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.stages.scoring.reliability import reliability
from b23d.stages.solvers.belonging import class_confidence
from b23d.stages.solvers.calibration import NEARNESS, LogisticMap, fitted, log_odds
from b23d.stages.solvers.posterior.holding_out import FOLDS, folds
from tests.test_posterior import box_cloud, run, taught

RANDOM = np.random.default_rng(0)


def told(offset: float, slope: float, count: int = 20_000) -> tuple[np.ndarray, np.ndarray]:
    """What is said, and whether it is true with the probability that the map makes of it."""
    said = RANDOM.uniform(0.02, 0.98, count)
    return said, RANDOM.random(count) < LogisticMap(offset, slope)(said)


def test_what_is_right_as_often_as_it_says_has_no_calibration_error_and_shuffled_it_has() -> None:
    said, true = told(0, 1)
    found, shuffled = reliability(said, true), reliability(RANDOM.permutation(said), true)
    assert found is not None and shuffled is not None
    assert found.error < 0.015 and shuffled.error > 0.2
    assert found.counts.sum() == len(said)


def test_always_half_and_half_right_is_calibrated_and_always_sure_and_wrong_is_not_at_all() -> None:
    half, wrong = reliability(np.full(10, 0.5), np.arange(10) % 2 == 0), reliability(np.ones(4), np.zeros(4, bool))
    assert half is not None and half.error == 0 and half.counts.tolist() == [10]
    assert wrong is not None and wrong.error == 1
    assert reliability(np.zeros(0), np.zeros(0, bool)) is None


@pytest.mark.parametrize(("offset", "slope"), [(0.0, 1.0), (-1.5, 0.5), (1.0, 1.7)])
def test_many_observations_give_the_map_that_made_them_and_mend_the_calibration(offset: float, slope: float) -> None:
    said, true = told(offset, slope)
    found = fitted(said, true, LogisticMap(0, 1))
    assert (found.offset, found.slope) == (pytest.approx(offset, abs=0.1), pytest.approx(slope, abs=0.1))
    mended = reliability(found(said), true)
    assert mended is not None and mended.error < 0.02


def test_nothing_observed_leaves_the_map_of_development_classes_and_little_moves_it_little() -> None:
    nothing = fitted(np.zeros(0), np.zeros(0, bool), NEARNESS)
    assert nothing == NEARNESS
    said, true = RANDOM.uniform(size=2000), np.ones(2000, bool)
    moved = [fitted(said[:n], true[:n], NEARNESS).offset - NEARNESS.offset for n in (2, 20, 2000)]
    assert 0 <= moved[0] < moved[1] < moved[2]
    unsure = fitted(said[:2], true[:2], NEARNESS, weight=0.1).offset - NEARNESS.offset
    assert unsure < moved[0] / 2, "of observations that count a tenth, as little as is due"


@settings(max_examples=50, deadline=None)
@given(st.lists(st.tuples(st.floats(0, 1), st.booleans()), max_size=30))
def test_a_map_never_descends_and_stays_a_probability(observed: list[tuple[float, bool]]) -> None:
    said, true = np.array([one for one, _ in observed]), np.array([one for _, one in observed], bool)
    found = fitted(said, true, NEARNESS)(np.linspace(0, 1, 50))
    assert ((found >= 0) & (found <= 1)).all() and (np.diff(found) >= 0).all()


def test_log_odds_are_finite_and_ascend() -> None:
    odds = log_odds(np.linspace(0, 1, 11))
    assert np.isfinite(odds).all() and (np.diff(odds) > 0).all() and odds[5] == pytest.approx(0)


@pytest.mark.parametrize(("shots", "held"), [(1, 0), (2, 2), (5, 5), (40, FOLDS)])
def test_what_is_held_out_does_not_grow_with_the_shots(shots: int, held: int) -> None:
    found = folds(np.ones((shots, 3), bool))
    assert len(found) == held and (not held or (found[0], found[-1]) == (0, shots - 1))
    lacking = np.ones((shots + 1, 3), bool)
    lacking[0] = False
    assert 0 not in folds(lacking)


def test_shots_found_by_the_others_are_written_down() -> None:
    model = taught([box_cloud(0), box_cloud(1), box_cloud(2, keypoints=6)])
    assert np.isfinite(model.held_out_sure).all() and model.held_out_near.mean() > 0.5
    assert not model.held_out_near[2, 6:].any(), "what a shot lacks is nowhere near"
    assert model.sureness != (NEARNESS.offset, NEARNESS.slope)
    alone = taught([box_cloud(0)])
    assert np.isnan(alone.held_out_sure).all() and alone.sureness == (NEARNESS.offset, NEARNESS.slope)


def test_labels_that_are_noise_are_trusted_less() -> None:
    """The confidence of the same target falls where the shots contradict each other."""
    good = [box_cloud(i) for i in range(3)]
    bad = []
    for i, (shape, described, geodesic, keypoints) in enumerate(good):
        at = np.random.default_rng(i).permutation(400)[:8].astype(np.int32)
        positions = shape.points[at].astype(np.float64)
        bad.append(
            (shape, described, geodesic, keypoints.model_copy(update={"point_indices": at, "positions": positions}))
        )
    sure, unsure = (run(box_cloud(7), shots).confidence for shots in (good, bad))
    assert sure is not None and unsure is not None and sure.mean() > unsure.mean() + 0.2


def sure_of_class(of: int, channels: int = 16) -> list[float]:
    """By shots of one look, of shapes of that look and of others."""
    looks = np.random.default_rng(of).normal(size=(6, channels))
    cell = np.random.default_rng(of).random((6, 1000)) < 0.05

    def shape(look: int, i: int) -> tuple[np.ndarray, np.ndarray]:
        random = np.random.default_rng(100 * look + i)
        surface = (cell[look] ^ (random.random(1000) < 0.005)).astype(np.float32)
        return (looks[look] + random.normal(0, 0.1, channels)).astype(np.float32), surface / surface.sum()

    shots = [shape(0, i) for i in range(3)]
    model = taught([box_cloud(i) for i in range(3)]).model_copy(
        update={"mean_features": np.stack([s[0] for s in shots]), "occupancy": np.stack([s[1] for s in shots])}
    )
    found = [class_confidence(model, *shape(look, 9)) for look in range(6)]
    return [one for one in found if one is not None]


@pytest.mark.parametrize("of", [0, 1, 2])
def test_a_stranger_among_a_class_is_told_from_its_members(of: int) -> None:
    member, *strangers = sure_of_class(of)
    assert member > 0.5 > max(strangers) and len(strangers) == 5


def test_a_shape_of_the_class_is_one_and_one_shot_cannot_tell() -> None:
    shots = [box_cloud(i) for i in range(3)]
    assert (run(shots[1], shots).class_confidence or 0) > 0.9, "a shot itself"
    assert run(box_cloud(7), shots[:1]).class_confidence is None
    shape, described, *rest = box_cloud(7)
    other = described.model_copy(update={"features": (3 - 4 * described.features).astype(np.float16)})
    longer = shape.model_copy(update={"points": shape.points * np.float32([1, 3, 0.2])})
    strange = run((longer, other, *rest), shots, method="nearest").class_confidence  # type: ignore[arg-type]
    member = run(box_cloud(7), shots, method="nearest").class_confidence
    assert strange is not None and member is not None and strange < member


def test_copies_of_a_shot_tell_no_more_of_a_class_than_it_does() -> None:
    shots, target = [box_cloud(i) for i in range(3)], box_cloud(7)
    assert run(target, [shots[0]] * 4).class_confidence is None
    once, often = (run(target, [*shots, *more]).class_confidence for more in ([], [shots[0]] * 9))
    assert once is not None and once == pytest.approx(often)
