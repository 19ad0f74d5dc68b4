"""Which shots count for where a target's keypoints are: the weights, and what they are worth on families of shapes."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.shot_model import ShotModel
from b23d.stages.solvers.likeness import occupancy
from b23d.stages.solvers.nearness import among, effective, nearness, softened
from b23d.stages.solvers.posterior.geometry import Prepared, in_box, prepare, squared
from b23d.stages.solvers.posterior.learning import deviations_of, learned_covariance
from b23d.stages.solvers.posterior.options import PosteriorParams
from b23d.stages.solvers.posterior.predicting import unary_costs
from b23d.stages.solvers.posterior.weighing import weighed
from b23d.stages.solvers.retrieval import mean_feature
from b23d.stages.solvers.scaling import relative_distances
from tests.test_posterior import PARAMS, Parts, box_cloud, run, taught

TIP = 8


def with_tower(seed: int) -> Parts:
    """A box as `box_cloud`'s, on which a tower as high again stands, whose tip is one keypoint more."""
    shape, described, _, _ = box_cloud(seed)
    rng = np.random.default_rng(seed)
    side, height = shape.points.max(0) * 0.3, shape.points[:, 1].max()
    tower = rng.uniform(-1, 1, (120, 3)) * [side[0], height, side[2]] + [0, 2 * height, 0]
    tower[0] = [0, 3 * height, 0]
    points = np.concatenate([shape.points, tower]).astype(np.float32)
    basis = np.random.default_rng(99).normal(size=(3, 24))
    looks = np.concatenate([np.sin(3 * tower @ basis), 0.02 * rng.normal(size=(120, 8)) + 1], 1)
    features = np.concatenate([described.features, looks.astype(np.float16)])
    n = len(points)
    ids = np.arange(TIP + 1, dtype=np.int32)
    at = np.append(np.arange(8), n - 120).astype(np.int32)
    distances = np.linalg.norm(points[:, None] - points[None], axis=2).astype(np.float16)
    return (
        shape.model_copy(update={
            "vertices": points, "points": points, "point_faces": np.full(n, -1, np.int32),
            "point_barycentrics": np.zeros((n, 3), np.float32),
        }),
        PointFeatures(features=features, counts=np.ones(n, np.int32), observed=np.ones(n, bool), descriptor="made up"),
        GeodesicDistances(distances=distances, components=np.zeros(n, np.int32), method="euclidean"),
        Keypoints(ids=ids, positions=points[at].astype(np.float64), point_indices=at),
    )  # fmt: skip


@functools.cache
def families() -> ShotModel:
    """Of fourteen boxes, and six that a tower stands on."""
    return taught([box_cloud(i) for i in range(14)] + [with_tower(i) for i in range(14, 20)])


def of(model: ShotModel, shape: NormalizedShape, described: PointFeatures) -> np.ndarray:
    cells = occupancy(in_box(shape.points)[0])
    return nearness(model, np.ones(len(model.shots)), cells, mean_feature(described))


@settings(max_examples=50, deadline=None)
@given(st.integers(3, 60), st.integers(0, 10_000))
def test_so_many_shots_are_left_and_their_order_does_not_matter(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    shared, alike = rng.uniform(0, 1, (2, count))
    found = softened(shared, alike)
    assert effective(found) >= min(count, count**0.5 + 0.5) * (1 - 1e-3), "more where several are as like"
    assert found.max() == 1 and (found >= 0).all()
    order = rng.permutation(count)
    np.testing.assert_allclose(softened(shared[order], alike[order]), found[order], rtol=1e-6, atol=1e-12)
    best = (shared >= shared[found.argmax()]) & (alike > alike[found.argmax()])
    assert not best.any(), "what is as like in one respect and more in the other weighs no less"


@pytest.mark.parametrize("count", [3, 10, 25, 50])
def test_about_the_root_of_the_shots_is_left(count: int) -> None:
    shared = np.random.default_rng(0).uniform(0, 1, count)
    assert effective(softened(shared, shared)) == pytest.approx(count**0.5 + 0.5, rel=1e-3)


@pytest.mark.parametrize("count", [1, 2, 9])
def test_shots_that_are_all_alike_count_alike(count: int) -> None:
    assert softened(np.full(count, 0.4), np.full(count, 0.9)).tolist() == [1.0] * count


def test_what_is_not_used_or_has_no_keypoints_is_near_nothing() -> None:
    model = taught([box_cloud(0), box_cloud(1), box_cloud(2, keypoints=0), box_cloud(3)])
    weights = np.array([1.0, 0.0, 1.0, 1.0])
    found = nearness(model, weights, model.occupancy[0], model.mean_features[0])
    assert (found > 0).tolist() == [True, False, False, True]


def test_near_shots_are_those_of_the_family() -> None:
    model = families()
    tower, plain = of(model, *with_tower(30)[:2]), of(model, *box_cloud(30)[:2])
    assert tower[14:].sum() > 10 * tower[:14].sum()
    assert plain[:14].sum() > 10 * plain[14:].sum()
    near = among(model.has.any(1), model.occupancy, model.mean_features)
    assert not near.diagonal().any() and near[14, 15:].sum() > 5 * near[14, :14].sum()


def test_places_come_from_the_family_and_not_from_the_mean_of_all() -> None:
    model, target = families(), with_tower(30)
    truth = in_box(target[0].points)
    box = truth[0][target[3].point_indices] / truth[1]
    alike = weighed(model, np.ones(20))
    local = weighed(model, np.ones(20), of(model, *target[:2]))
    far, near = (np.linalg.norm((one.places - box)[:8], axis=1).mean() for one in (alike, local))
    assert near < 0.2 * far
    np.testing.assert_array_equal(local.keypoint, alike.keypoint)  # what they look like is learned from all
    np.testing.assert_array_equal(local.identity, alike.identity)


def test_an_id_of_one_family_is_found_there_and_not_elsewhere() -> None:
    shots = [box_cloud(i) for i in range(12)] + [with_tower(i) for i in range(12, 15)]
    tower, plain = run(with_tower(30), shots), run(box_cloud(30), shots)
    assert tower.ids[-1] == plain.ids[-1] == TIP
    assert tower.present.all()
    assert plain.present[:8].all() and not plain.present[TIP]
    assert np.linalg.norm(tower.positions - with_tower(30)[3].positions, axis=1).max() < 0.1


def test_copies_of_a_shot_teach_where_keypoints_are_as_it_does() -> None:
    model = taught([box_cloud(0)] * 6)
    found = weighed(model, np.ones(6), of(model, *box_cloud(5)[:2]))
    np.testing.assert_allclose(found.places, model.places[0], atol=1e-6)
    np.testing.assert_allclose(found.shifts, model.shifts[0], atol=1e-6)
    assert model.shift_squares.max() < 1e-20 and (model.deviating == 6).all()
    np.testing.assert_allclose(found.occurrence, 1)


def test_one_shot_says_what_it_did_when_no_other_could_say_more() -> None:
    """Constants as they are: shifts of the standard deviation given, weights as given, every id."""
    model, params = taught([box_cloud(0)]), PosteriorParams()
    shape, described, geodesic, _ = box_cloud(5)
    target: Prepared = prepare(
        shape.points, described.features.astype(np.float32), relative_distances(geodesic.distances), PARAMS.radii
    )
    learned = weighed(model, np.ones(1), of(model, shape, described))
    looks = (np.concatenate([target.features @ model.basis, target.geometry], 1) - model.mean) / model.scale
    weights = params.keypoint_weight * learned.keypoint + params.identity_weight * learned.identity
    shifts = squared(learned.shifts, target.shift) / (2 * params.shift_sd**2)
    np.testing.assert_allclose(unary_costs(learned, target, params), shifts - weights @ looks.T, rtol=1e-3, atol=1e-3)
    assert model.gate == 1 and not model.deviating.any()
    assert run(box_cloud(5), [box_cloud(0)]).present.all()


def test_more_examples_weigh_an_id_s_own_looks_more() -> None:
    """In the end as much as what all ids have in common: its plain discriminant."""
    model, params = taught([box_cloud(0), box_cloud(1)]), PosteriorParams(shift_sd=1e6)
    shape, described, geodesic, _ = box_cloud(5)
    target = prepare(
        shape.points, described.features.astype(np.float32), relative_distances(geodesic.distances), PARAMS.radii
    )
    many = weighed(model.model_copy(update={"shift_squares": np.full_like(model.shift_squares, 1e12)}), np.full(2, 1e9))
    looks = (np.concatenate([target.features @ model.basis, target.geometry], 1) - model.mean) / model.scale
    plain = -(many.keypoint + many.identity) @ looks.T
    np.testing.assert_allclose(unary_costs(many, target, params), plain, rtol=1e-3, atol=1e-3)


# deviations


def test_deviations_are_from_the_others_weighted_mean() -> None:
    rng = np.random.default_rng(0)
    has, values, near = rng.random((5, 4)) < 0.7, rng.normal(size=(5, 4, 3)), rng.random((5, 5))
    has[:, 3] = [True, False, False, False, False]  # what no other has
    found = deviations_of(has, values, near)
    for t in range(5):
        for k in range(4):
            others = [s for s in range(5) if s != t and has[s, k]]
            if not has[t, k] or not others:
                assert np.isnan(found[t, k]).all()
            else:
                mean = np.average(values[others, k], axis=0, weights=near[t, others])
                np.testing.assert_allclose(found[t, k], values[t, k] - mean, atol=1e-4)


def test_the_learned_covariance_lies_between_the_prior_and_what_deviations_show() -> None:
    rng = np.random.default_rng(1)
    shape = rng.normal(size=(6, 6))
    true, prior = 0.01 * (shape @ shape.T + np.eye(6)), 0.03 * np.eye(6)
    drawn = np.einsum("ij,sjx->six", np.linalg.cholesky(true), rng.normal(size=(4000, 6, 3)))
    np.testing.assert_allclose(learned_covariance(drawn, prior, 5.0), true, atol=0.08 * true.max())
    np.testing.assert_array_equal(learned_covariance(drawn[:0], prior, 5.0), prior)
    np.testing.assert_allclose(learned_covariance(drawn[:3], prior, 1e9), prior, atol=1e-6)
    assert np.linalg.eigvalsh(learned_covariance(drawn[:1], prior, 2.0)).min() > 0


def test_where_shots_lack_ids_the_prior_fills_in() -> None:
    rng = np.random.default_rng(2)
    prior = 0.02 * (np.eye(5) + 0.5)
    drawn = np.einsum("ij,sjx->six", np.linalg.cholesky(prior), rng.normal(size=(6000, 5, 3)))
    drawn[rng.random((6000, 5)) < 0.4] = np.nan
    np.testing.assert_allclose(learned_covariance(drawn, prior, 1.0), prior, atol=0.05 * prior.max())
