"""Large inputs: distances by landmarks, clouds drawn from some of their points."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import dijkstra

from b23d.stages.backproject import BackprojectParams, backproject
from b23d.stages.extract import ExtractParams, extract
from b23d.stages.geodesic import GeodesicParams, geodesic
from b23d.stages.geodesics.graph import edge_graph, neighbour_edges
from b23d.stages.geodesics.landmarks import landmark_distances
from b23d.stages.render import RenderParams, render
from b23d.stages.renderers.discs import drawn_points
from tests.made_shapes import of_cloud


def sphere(count: int, seed: int = 0) -> np.ndarray:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return points / 2 / np.linalg.norm(points, axis=1, keepdims=True)


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 99), st.integers(60, 300))
def test_landmarks_never_shorten_and_rarely_lengthen(seed: int, count: int) -> None:
    """On two spheres that nothing joins."""
    points = np.concatenate([sphere(1000, seed), sphere(30, seed) + 3])
    graph = edge_graph(len(points), *neighbour_edges(points, 12))
    exact, found = dijkstra(graph), landmark_distances(graph, points, count).astype(np.float64)
    np.testing.assert_array_equal(found, found.T)
    np.testing.assert_array_equal(np.isinf(found), np.isinf(exact))
    assert (np.diag(found) == 0).all()
    joined = np.isfinite(exact) & (exact > 0)
    ratio = found[joined] / exact[joined]
    assert ratio.min() > 1 - 2**-10  # float16
    assert ratio.mean() < 1.02 and np.quantile(ratio, 0.99) < 1.1


def test_every_point_a_landmark_is_exact() -> None:
    points = sphere(200)
    graph = edge_graph(200, *neighbour_edges(points, 8))
    np.testing.assert_allclose(landmark_distances(graph, points, 200), dijkstra(graph), rtol=1e-3)


def test_many_candidates_say_how_their_distances_came(monkeypatch: pytest.MonkeyPatch) -> None:
    shape = of_cloud(sphere(600), count=600)
    exact = geodesic(shape, GeodesicParams())
    monkeypatch.setattr("b23d.stages.geodesic.EXACT", 500)
    found = geodesic(shape, GeodesicParams())
    assert (exact.method, found.method) == ("graph", "graph by landmarks")
    np.testing.assert_allclose(found.distances, exact.distances, rtol=1e-3)  # as many landmarks as points
    assert geodesic(shape, GeodesicParams(method="euclidean")).method == "euclidean"
    with pytest.raises(ValueError, match='expected at most 500 for "heat", which solves once for each, got 600; lower'):
        geodesic(shape, GeodesicParams(method="heat"))


def test_a_large_cloud_is_drawn_from_some_of_its_points(monkeypatch: pytest.MonkeyPatch) -> None:
    params = RenderParams(rings={"count": 1}, resolution=64)
    shape = of_cloud(sphere(3000), count=64)
    whole = render(shape, params)
    monkeypatch.setattr("b23d.stages.renderers.discs.MOST", 1500)
    chosen = drawn_points(shape.vertices)
    assert len(chosen) == 1500 and (np.diff(chosen) > 0).all()
    views = render(shape, params)
    assert set(np.unique(views.face_ids)) <= {-1, *chosen}
    seen = (views.face_ids >= 0) & (whole.face_ids >= 0)
    assert seen.sum() > 0.97 * (whole.face_ids >= 0).sum()
    assert np.abs(views.depth - whole.depth)[seen].mean() < 0.01
    for visibility in ("point", "face"):
        found = backproject(shape, views, extract(views, ExtractParams()), BackprojectParams(visibility=visibility))
        assert found.observed.mean() > 0.95


def test_a_cloud_with_every_point_several_times_looks_as_with_each_once() -> None:
    params = RenderParams(rings={"count": 1}, resolution=64)
    points = sphere(1000)
    once, often = (of_cloud(cloud, count=64) for cloud in (points, np.concatenate([points] * 9)))
    plain, copied = render(once, params), render(often, params)
    assert (plain.face_ids >= 0).any()
    np.testing.assert_array_equal(copied.face_ids, plain.face_ids)
    np.testing.assert_array_equal(copied.images, plain.images)


@pytest.mark.slow
def test_16384_candidates() -> None:
    points = sphere(16_384)
    found = geodesic(of_cloud(points, count=16_384), GeodesicParams())
    arcs = np.arccos(np.clip(4 * points[:50] @ points.T, -1, 1)) / 2
    far = arcs > 0.2
    assert found.method == "graph by landmarks"
    assert 0.99 < np.median(found.distances[:50][far] / arcs[far]) < 1.06
