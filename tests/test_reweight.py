"""reweight: Eq. 1's identities, filling, and what of them the released settings keep; how those differ:
`test_rows_features.py`."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.stages.reweight import ReweightParams, reweight

RELEASED = {"normalised": False, "weight": "views", "fill": "zeros"}


def line(count: int, spacing: float = 0.05) -> GeodesicDistances:
    at = np.arange(count) * spacing
    return distances(np.abs(at[:, None] - at))


def distances(matrix: np.ndarray) -> GeodesicDistances:
    return GeodesicDistances(
        distances=matrix.astype(np.float16), components=np.zeros(len(matrix), np.int32), method="graph"
    )


def seen(features: np.ndarray, counts: np.ndarray | None = None) -> PointFeatures:
    counts = np.ones(len(features)) if counts is None else counts
    return PointFeatures(
        features=np.where((counts > 0)[:, None], features, 0).astype(np.float16),
        counts=counts.astype(np.int32),
        observed=counts > 0,
        class_token=np.ones(features.shape[1], np.float32),
        descriptor="test",
    )


def run(points: PointFeatures, geodesic: GeodesicDistances, **params: object) -> np.ndarray:
    return reweight(points, geodesic, ReweightParams(**params)).features.astype(np.float32)


def random_case(seed: int, count: int = 40, channels: int = 5) -> tuple[PointFeatures, GeodesicDistances]:
    rng = np.random.default_rng(seed)
    places = rng.random((count, 3))
    counts = rng.integers(0, 5, count)
    counts[0] = 1
    return seen(rng.normal(size=(count, channels)), counts), distances(np.linalg.norm(places[:, None] - places, axis=2))


@settings(deadline=None, max_examples=20)
@given(
    seed=st.integers(0, 999),
    sigma=st.sampled_from([0.0, 1e-4, 0.01, 0.3]),
    weight=st.sampled_from(["point", "views"]),
    batches=st.sampled_from([1, 3]),
)
def test_constant_features_stay_constant(seed: int, sigma: float, weight: str, batches: int) -> None:
    points, geodesic = random_case(seed)
    points = seen(np.full(points.features.shape, 2.5), points.counts)
    np.testing.assert_allclose(run(points, geodesic, sigma=sigma, weight=weight, batches=batches), 2.5, rtol=1e-3)


def test_equation_one() -> None:
    points, geodesic = random_case(0)
    d, f, visible = geodesic.distances.astype(np.float64), points.features.astype(np.float64), points.observed
    w = np.exp(-(d**2) / (2 * 0.2**2))[:, visible]
    np.testing.assert_allclose(run(points, geodesic, sigma=0.2), w @ f[visible] / w.sum(1, keepdims=True), atol=2e-3)


@pytest.mark.parametrize("sigma", [0.0, 1e-6, 1e-3])
def test_a_small_sigma_leaves_seen_points_and_fills_with_the_nearest_seen(sigma: float) -> None:
    points, geodesic = random_case(1)
    result = run(points, geodesic, sigma=sigma)
    np.testing.assert_array_equal(result[points.observed], points.features[points.observed].astype(np.float32))
    nearest = np.flatnonzero(points.observed)[geodesic.distances[:, points.observed].argmin(axis=1)]
    np.testing.assert_allclose(result, points.features[nearest].astype(np.float32), atol=1e-3)


def test_views_that_are_all_doubled_change_nothing() -> None:
    points, geodesic = random_case(2)
    twice = seen(points.features, points.counts * 2)
    for params in ({"weight": "views"}, RELEASED):
        np.testing.assert_allclose(
            run(points, geodesic, sigma=0.2, **params), run(twice, geodesic, sigma=0.2, **params), atol=2e-3
        )


def test_views_weighting_is_the_mean_over_all_single_views() -> None:
    result = run(
        seen(np.array([[0.0], [1.0]]), np.array([3, 1])), distances(np.zeros((2, 2))), sigma=0.1, weight="views"
    )
    np.testing.assert_allclose(result, 0.25)


@pytest.mark.parametrize("params", [{}, RELEASED], ids=["corrected", "released"])
def test_linear_in_the_features(params: dict) -> None:
    points, geodesic = random_case(3)
    other = seen(np.random.default_rng(4).normal(size=points.features.shape), points.counts)
    both = seen(points.features.astype(np.float32) + 2 * other.features.astype(np.float32), points.counts)
    parts = [run(p, geodesic, sigma=0.1, **params) for p in (points, other)]
    np.testing.assert_allclose(run(both, geodesic, sigma=0.1, **params), parts[0] + 2 * parts[1], atol=0.02)


@pytest.mark.parametrize("params", [{}, RELEASED], ids=["corrected", "released"])
def test_permutation_equivariant(params: dict) -> None:
    points, geodesic = random_case(5)
    order = np.random.default_rng(6).permutation(40)
    moved = seen(points.features[order], points.counts[order])
    shuffled = distances(geodesic.distances[np.ix_(order, order)])
    np.testing.assert_allclose(
        run(moved, shuffled, sigma=0.1, **params), run(points, geodesic, sigma=0.1, **params)[order], atol=2e-3
    )


def test_a_part_without_any_seen_point_takes_the_mean() -> None:
    apart = np.full((3, 3), np.inf)
    np.fill_diagonal(apart, 0)
    result = run(seen(np.array([[1.0], [3.0], [0.0]]), np.array([1, 1, 0])), distances(apart), sigma=0.1)
    np.testing.assert_allclose(result[:, 0], [1, 3, 2])


def test_everything_but_the_features_is_kept() -> None:
    points, geodesic = random_case(9)
    result = reweight(points, geodesic, ReweightParams())
    for name in ("counts", "observed", "class_token"):
        np.testing.assert_array_equal(getattr(result, name), getattr(points, name))
    assert result.descriptor == "test"


def test_errors_say_what_to_do() -> None:
    points, geodesic = random_case(10)
    with pytest.raises(ValueError, match="at least one candidate that a view saw"):
        reweight(seen(np.ones((40, 5)), np.zeros(40)), geodesic, ReweightParams())
    with pytest.raises(ValueError, match="expected 40 candidates, got 7"):
        reweight(points, line(7), ReweightParams())
    with pytest.raises(ValueError, match="lower sigma or batches"):
        at = np.r_[np.zeros(40), 1 + np.arange(400)]
        reweight(seen(np.full((440, 1), 3e4)), distances(np.abs(at[:, None] - at)), ReweightParams(normalised=False))


@pytest.mark.parametrize(
    "params", [{}, {"weight": "views"}, {"normalised": False}, {"fill": "zeros"}, {**RELEASED, "batches": 3}]
)
@pytest.mark.parametrize("sigma", [1e-3, 0.02, 0.1])
def test_leaving_far_weights_out_changes_nothing_but_roundings(
    params: dict, sigma: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Points on a long line, whose pairs are mostly beyond any weight; a stretch that no view saw."""
    rng = np.random.default_rng(0)
    at = np.sort(rng.random(300)) * 8
    counts = rng.integers(1, 62, 300)
    counts[100:180] = 0
    points, geodesic = seen(rng.normal(size=(300, 4)), counts), distances(np.abs(at[:, None] - at))
    found = []
    for share in (1.0, -1.0):
        monkeypatch.setattr("b23d.stages.reweight.SPARSE", share)
        found.append(run(points, geodesic, sigma=sigma, **params))
    sparse, full = found
    np.testing.assert_allclose(sparse, full, rtol=2e-3, atol=1e-3 * np.abs(full).max())
