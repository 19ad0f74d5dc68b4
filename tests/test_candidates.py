"""Candidate points: on the surface, seeded, uniform, and spread as far as they can be."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from b23d.schemas.shape import Source
from b23d.stages.geometry.sampling import farthest_points, surface_samples
from b23d.stages.normalize import NormalizeParams, normalize
from tests.made_shapes import ROUGH, obj, of_cloud, of_mesh, on_surface


def test_candidates_lie_where_they_say() -> None:
    shape = of_mesh(ROUGH.vertices, ROUGH.faces, count=500)
    assert shape.candidates == "fps"
    assert shape.points.shape == (500, 3)
    assert len(np.unique(shape.points, axis=0)) == 500
    np.testing.assert_allclose(on_surface(shape), shape.points, atol=2e-7)
    assert (shape.point_barycentrics >= 0).all()


def test_same_seed_same_candidates_other_seed_others() -> None:
    one, same, other = (of_mesh(ROUGH.vertices, ROUGH.faces, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.points, same.points)
    np.testing.assert_array_equal(one.point_faces, same.point_faces)
    assert (one.points != other.points).any()


def test_samples_are_uniform_over_the_area() -> None:
    """Two squares, one of nine times the other's area; within each, the mean and the variance of a uniform law."""
    v = np.array([[0, 0, 0], [3, 0, 0], [3, 3, 0], [0, 3, 0], [9, 0, 0], [10, 0, 0], [10, 1, 0], [9, 1, 0]], np.float64)
    f = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    p = surface_samples(v, f, 20_000, np.random.default_rng(0)).points
    large = p[p[:, 0] < 5]
    assert len(large) == pytest.approx(18_000, abs=2)
    np.testing.assert_allclose(large.mean(axis=0), [1.5, 1.5, 0], atol=0.03)
    np.testing.assert_allclose(large.var(axis=0), [0.75, 0.75, 0], atol=0.03)


def test_farthest_points_spread_as_far_as_the_greedy_rule_promises() -> None:
    """No two chosen are nearer than any point is to its nearest chosen one (Gonzalez 1985), and no point is chosen
    twice."""
    points = np.random.default_rng(1).random((3000, 3)).astype(np.float32)
    chosen = farthest_points(points, 200)
    assert len(set(chosen)) == 200
    covering = cKDTree(points[chosen]).query(points)[0].max()
    gaps = cdist(points[chosen], points[chosen])[~np.eye(200, dtype=bool)]
    assert gaps.min() >= covering * (1 - 1e-5)
    np.testing.assert_array_equal(chosen, farthest_points(points, 200))


@pytest.mark.parametrize("count", [1, 2, 3, 50])
def test_few_points_to_choose_from(count: int) -> None:
    points = np.random.default_rng(0).random((count, 3))
    assert (
        farthest_points(points, 3).tolist() == list(range(count))
        if count <= 3
        else len(set(farthest_points(points, 3))) == 3
    )


def test_a_cloud_is_taken_whole_and_in_order_unless_it_is_large() -> None:
    points = np.random.default_rng(0).normal(size=(300, 3))
    whole = of_cloud(points)
    assert whole.candidates == "cloud"
    np.testing.assert_array_equal(whole.points, whole.vertices)
    np.testing.assert_allclose(whole.points * whole.scale + whole.center, points, atol=1e-6)
    assert (whole.point_faces == -1).all()
    assert whole.kind == "cloud"
    for params in ({"cloud_limit": 200}, {"candidates": "fps"}):
        fewer = of_cloud(points, **params)
        assert fewer.candidates == "fps"
        assert len(fewer.points) == 128
        assert len(fewer.vertices) == 300
        assert {tuple(p) for p in fewer.points} <= {tuple(p) for p in fewer.vertices}
    assert of_cloud(points, cloud_limit=200, candidates="cloud").candidates == "cloud"


def test_a_large_cloud_with_holes_has_no_more_candidates_than_without() -> None:
    points = np.random.default_rng(0).normal(size=(10_000, 3))
    counts = [len(of_cloud(points[:left], count=2048).points) for left in (10_000, 8000, 5000)]
    assert counts == [2048, 2048, 2048]


def test_a_mesh_file_with_points_only_is_a_cloud() -> None:
    source = Source(shape="s", files={"m.obj": obj(ROUGH.vertices, [])}, mesh="m.obj")
    shape = normalize(source, NormalizeParams())
    assert (shape.kind, shape.candidates, len(shape.points)) == ("cloud", "cloud", len(ROUGH.vertices))


def test_a_cloud_on_its_mesh_knows_its_faces() -> None:
    """Points made on known faces are found there again, and lie on them."""
    made = surface_samples(ROUGH.vertices, ROUGH.faces, 400, np.random.default_rng(0))
    shape = of_mesh(ROUGH.vertices, ROUGH.faces, made.points)
    assert shape.candidates == "cloud"
    np.testing.assert_allclose(on_surface(shape), shape.points, atol=1e-6)
    inside = made.barycentrics.min(axis=1) > 1e-3
    np.testing.assert_array_equal(shape.point_faces[inside], made.faces[inside])
