"""Neighbourhoods of the shots' keypoints, laid on the target's: a known shift is found, from place and looks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from b23d.schemas.shot_model import ShotModel
from b23d.stages.solvers.posterior.geometry import Prepared
from b23d.stages.solvers.posterior.neighbourhoods import SD, Neighbourhoods, around, shifts, told_by_neighbourhoods
from b23d.stages.solvers.posterior.weighing import weighed
from tests.test_posterior import box_cloud, prepared, taught

BASIS = np.eye(32, 24, dtype=np.float32)
ONES = np.ones(3)


@pytest.fixture(scope="module")
def model() -> ShotModel:
    return taught([box_cloud(seed) for seed in range(3)])


def patch(seed: int) -> Neighbourhoods:
    """A piece of a plane whose looks change from place to place."""
    places = np.random.default_rng(seed).uniform(-0.15, 0.15, (1, 300, 3)) * [1, 1, 0]
    looks = np.sin(12 * places @ np.random.default_rng(9).normal(size=(3, 6)))
    looks /= np.linalg.norm(looks, axis=2, keepdims=True)
    return Neighbourhoods(places.astype(np.float32), looks.astype(np.float32))


def test_on_itself_a_neighbourhood_stays() -> None:
    one = patch(0)
    np.testing.assert_allclose(shifts(one, Neighbourhoods(one.places[0], one.looks[0])), 0, atol=2e-3)


@pytest.mark.parametrize("shift", [(0.03, 0, 0), (0, -0.05, 0), (0.02, 0.04, 0), (0, 0, 0.04)])
def test_a_shift_is_found(shift: tuple[float, float, float]) -> None:
    one, moved = patch(0), np.array(shift, np.float32)
    found = shifts(one, Neighbourhoods(one.places[0] + moved, one.looks[0]))
    np.testing.assert_allclose(found[0], moved, atol=0.006)


def test_each_neighbourhood_is_shifted_by_itself() -> None:
    one, other = patch(0), patch(1)
    both = Neighbourhoods(*(np.concatenate(pair) for pair in ((one.places, other.places), (one.looks, other.looks))))
    here = Neighbourhoods(one.places[0] + np.float32(0.02), one.looks[0])
    np.testing.assert_allclose(shifts(both, here), np.concatenate([shifts(one, here), shifts(other, here)]), atol=1e-6)


@pytest.mark.parametrize("count", [1, 5, 64])
def test_what_lies_around_is_within_reach_and_as_many_as_asked(count: int) -> None:
    shape = prepared(0)
    found = around(shape, np.array([0, 7, 100]), BASIS, 0.2, count)
    assert found.places.shape == (3, count, 3) and found.looks.shape == (3, count, 24)
    assert np.linalg.norm(found.places, axis=2).max() <= 0.2 + 1e-6


def test_a_point_with_nothing_around_it_is_its_own_neighbourhood() -> None:
    found = around(prepared(0), np.array([3]), BASIS, 1e-6, 4)
    assert not found.places.any()


def test_what_lies_around_does_not_depend_on_the_order_of_candidates() -> None:
    shape, order = prepared(0), np.random.default_rng(0).permutation(400)
    other = replace(shape, position=shape.position[order], features=shape.features[order])
    where = np.argsort(order)[[4, 40]]
    one, two = around(shape, np.array([4, 40]), BASIS, 0.3, 20), around(other, where, BASIS, 0.3, 20)
    np.testing.assert_array_equal(two.places, one.places)
    np.testing.assert_allclose(two.looks, one.looks, atol=1e-6)


def costs(model: ShotModel, near: np.ndarray, target: Prepared, points: np.ndarray) -> np.ndarray:
    return told_by_neighbourhoods(weighed(model, ONES), near, target, points)


def test_the_neighbourhood_of_a_shot_s_own_keypoint_lies_where_it_is(model: ShotModel) -> None:
    shape = prepared(0)
    own = costs(model, np.array([1.0, 0, 0]), shape, shape.keypoints)
    off = np.sqrt(2 * own[np.arange(8), shape.keypoints]) * SD
    assert off.max() < 0.01
    near = np.linalg.norm(shape.position[shape.keypoints][:, None] - shape.position, axis=2)
    np.testing.assert_allclose(np.sqrt(2 * own) * SD, near, atol=0.01)


def test_an_id_that_no_near_shot_has_is_told_nothing(model: ShotModel) -> None:
    lacking = model.has.copy()
    lacking[0, 2] = False
    some = costs(model.model_copy(update={"has": lacking}), np.array([1.0, 0, 0]), prepared(0), prepared(0).keypoints)
    assert not some[2].any() and some[[0, 1, 3]].any(1).all()


def test_shots_far_from_the_target_are_not_asked(model: ShotModel) -> None:
    target, at = prepared(5), prepared(5).keypoints
    far, gone = np.array([1.0, 0.8, 0.01]), np.array([1.0, 0.8, 0.0])
    np.testing.assert_array_equal(costs(model, far, target, at), costs(model, gone, target, at))
    assert not np.array_equal(costs(model, ONES, target, at), costs(model, gone, target, at))
