"""Shots laid over a target: a surface that is moved takes its keypoints along."""

from __future__ import annotations

import numpy as np
import pytest

from b23d.schemas.shot_model import ShotModel
from b23d.stages.solvers.posterior.geometry import Prepared, prepare
from b23d.stages.solvers.posterior.registering import SAMPLE, SpreadPoints, laid_over, moved, surface_of
from b23d.stages.solvers.posterior.weighing import weighed
from b23d.stages.solvers.scaling import relative_distances, scale_features
from tests.test_posterior import PARAMS, Parts, box_cloud, taught

ONES = np.ones(3)


def prepared(parts: Parts) -> Prepared:
    shape, described, geodesic, _ = parts
    features = scale_features(described.features, "centred-unit", described.observed)
    return prepare(shape.points, features, relative_distances(geodesic.distances), PARAMS.radii)


def surface(seed: int = 0) -> SpreadPoints:
    """Points of a box whose looks are smooth functions of place."""
    rng = np.random.default_rng(seed)
    box = rng.uniform(-0.5, 0.5, (SAMPLE, 3))
    box[np.arange(SAMPLE), rng.integers(0, 3, SAMPLE)] = 0.5
    return SpreadPoints(box, looks(box))


def looks(box: np.ndarray) -> np.ndarray:
    found = np.sin(3 * box @ np.random.default_rng(99).normal(size=(3, 24)))
    return np.asarray(found / np.linalg.norm(found, axis=1, keepdims=True))


@pytest.fixture(scope="module")
def model() -> ShotModel:
    return taught([box_cloud(seed) for seed in range(3)])


def test_on_itself_a_shot_s_keypoints_stay() -> None:
    one = surface()
    np.testing.assert_allclose(moved(one.box[:9], one, one, np.array([1, 0.6, 0.4])), one.box[:9], atol=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_keypoints_go_where_the_surface_around_them_goes(seed: int) -> None:
    """A part moved up by a smooth bump, which no box tells of."""
    one = surface(seed)

    def bent(places: np.ndarray) -> np.ndarray:
        lift = 0.2 * np.exp(-((places - [0.5, 0.0, 0.0]) ** 2).sum(1) / (2 * 0.4**2))
        return np.asarray(places + lift[:, None] * [0, 1, 0])

    other, at = SpreadPoints(bent(one.box), one.looks), one.box[:40]
    before = np.linalg.norm(at - bent(at), axis=1)
    after = np.linalg.norm(moved(at, one, other, ONES) - bent(at), axis=1)
    assert after.mean() < before.mean() / 2


def test_the_order_of_points_does_not_matter() -> None:
    one, other = surface(0), surface(1)
    order = np.random.default_rng(0).permutation(SAMPLE)
    mixed = SpreadPoints(other.box[order], other.looks[order])
    np.testing.assert_allclose(moved(one.box[:5], one, mixed, ONES), moved(one.box[:5], one, other, ONES), atol=1e-9)


def test_a_sample_is_the_same_whatever_the_order_of_candidates() -> None:
    shape = prepared(box_cloud(0))
    order = np.random.default_rng(0).permutation(len(shape.position))
    basis = np.eye(shape.features.shape[1], dtype=np.float32)
    mixed = Prepared(
        **vars(shape) | {"position": shape.position[order], "box": shape.box[order], "features": shape.features[order]}
    )
    np.testing.assert_array_equal(surface_of(mixed, basis).box, surface_of(shape, basis).box)


def test_a_shot_is_laid_over_itself(model: ShotModel) -> None:
    parts = box_cloud(0)
    found = laid_over(weighed(model, np.eye(3)[0]), np.eye(3)[0], prepared(parts))
    np.testing.assert_allclose(found.places, model.places[0], atol=0.03)


def test_only_places_and_how_sure_they_are_change(model: ShotModel) -> None:
    before = weighed(model, ONES)
    after = laid_over(before, ONES, prepared(box_cloud(5)))
    changed = {name for name, value in vars(after).items() if value is not vars(before)[name]}
    assert changed == {"places", "deviations"}
    assert (np.diag(after.deviations) < np.diag(before.deviations)).all()


def test_an_id_that_only_far_shots_have_stays_where_it_was_expected(model: ShotModel) -> None:
    has = model.has.copy()
    has[:2, 3] = False
    lacking = model.model_copy(update={"has": has})
    near = np.array([1.0, 1.0, 0.0])
    before = weighed(lacking, ONES, near)
    after = laid_over(before, near, prepared(box_cloud(5)))
    np.testing.assert_array_equal(after.places[3], before.places[3])
    assert after.deviations[3, 3] == before.deviations[3, 3]


def test_a_shot_of_no_weight_is_not_laid_over(model: ShotModel) -> None:
    target, weights = prepared(box_cloud(5)), np.array([1.0, 0.0, 1.0])
    apart = model.model_copy(update={"surface": model.surface + np.array([0, 1, 0], np.float32)[:, None, None]})
    np.testing.assert_array_equal(
        laid_over(weighed(model, weights), weights, target).places,
        laid_over(weighed(apart, weights), weights, target).places,
    )


@pytest.mark.parametrize("count", [1, 2, 5])
def test_few_candidates_and_flat_shapes_do_no_harm(count: int) -> None:
    flat = np.zeros((count, 3))
    flat[:, 0] = np.linspace(-0.5, 0.5, count)
    one = SpreadPoints(flat, np.zeros((count, 4)))
    assert np.isfinite(moved(flat, one, surface_without_looks(), np.array([1, 0.05, 0.05]))).all()


def surface_without_looks() -> SpreadPoints:
    return SpreadPoints(surface().box, np.zeros((SAMPLE, 4)))
