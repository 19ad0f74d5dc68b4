"""Farthest points, ISS, HARRIS-3D and SIFT, each against its own formula."""

from __future__ import annotations

import numpy as np
import pytest

from b23d.stages.detectors.farthest import farthest
from b23d.stages.detectors.harris3d import harris3d
from b23d.stages.detectors.iss import iss
from b23d.stages.detectors.neighbourhoods import ball_sums, scatter_matrices, strongest
from b23d.stages.detectors.sift3d import extrema, sift3d, surface_variation
from tests.made_detections import grid_cube, hills


def test_farthest_points_of_a_segment_are_its_ends_then_its_middle() -> None:
    places = np.linspace(0, 1, 101)
    chosen, gaps = farthest(np.abs(places[:, None] - places).astype(np.float16), 5)
    assert set(chosen[:2]) == {0, 100} and chosen[2] == 50 and set(places[chosen[3:]]) == {0.25, 0.75}
    np.testing.assert_allclose(gaps, [0.5, 1, 0.5, 0.25, 0.25], atol=1e-3)


def test_farthest_points_are_distinct_even_where_all_coincide_and_end_with_the_cloud() -> None:
    assert sorted(farthest(np.zeros((4, 4)), 9)[0]) == [0, 1, 2, 3]
    apart = np.full((4, 4), np.inf)
    apart[:2, :2] = apart[2:, 2:] = [[0, 1], [1, 0]]
    assert len(farthest(apart, 2)[0]) == 2


def test_strongest_keeps_what_nothing_near_exceeds() -> None:
    points = np.stack([np.arange(6) / 10, np.zeros(6), np.zeros(6)], axis=1)
    response = np.array([1, 2, 1, 3, 3, np.nan])
    assert strongest(points, response, 0.11).tolist() == [3, 1]
    assert strongest(points, response, 0.05).tolist() == [3, 4, 1, 0, 2]
    assert not len(strongest(points, np.zeros(6), 1.0))


def test_ball_sums_and_scatters_are_what_they_say() -> None:
    rng = np.random.default_rng(0)
    points, weights = rng.normal(size=(700, 3)), rng.uniform(1, 2, 700)
    near = np.linalg.norm(points[:, None] - points, axis=2) <= 0.5
    np.testing.assert_allclose(ball_sums(points, 0.5, weights[:, None])[:, 0], near @ weights)
    about, mean = scatter_matrices(points, 0.5, weights)
    offsets = points[near[3]] - points[3]
    share = weights[near[3]] / weights[near[3]].sum()
    np.testing.assert_allclose(about[3], (offsets * share[:, None]).T @ offsets, atol=1e-12)
    np.testing.assert_allclose(mean[3], share @ offsets, atol=1e-12)


def paraboloid(a: float, b: float, radius: float = 0.1) -> np.ndarray:
    line = np.linspace(-1, 1, 21)
    x, y = (values.ravel() for values in np.meshgrid(line, line))
    return np.stack([x, y, a * x * x / 2 + b * y * y / 2], axis=1)[np.hypot(x, y) <= 1] * radius


@pytest.mark.parametrize(("a", "b"), [(0.2, 0.2), (0.2, -0.2), (0.3, 0.0), (0.0, 0.0)])
def test_harris_is_the_closed_form_on_a_quadratic_patch(a: float, b: float) -> None:
    points = paraboloid(a, b)
    apex = int(np.linalg.norm(points, axis=1).argmin())
    expected = 4 * a * a * b * b - 0.04 * (2 * a * a + 2 * b * b) ** 2
    assert harris3d(points, 0.11, 0.04)[apex] == pytest.approx(expected * 1.1**4, abs=1e-4 + 0.15 * abs(expected))


def test_planes_have_no_keypoints_anywhere() -> None:
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (600, 3)) * [1, 1, 0]
    assert np.abs(iss(points, 0.1, 1, 1, 5)).max() < 1e-12
    assert harris3d(points, 0.1, 0.04).max() < 1e-12
    assert surface_variation(points, 0.1).max() < 1e-12 and not sift3d(points, 0.03, 2, 3, 1e-6).any()


def test_iss_on_a_cube_has_the_values_of_the_integrals() -> None:
    """About a corner of three quarter discs, λ3 / r² = 1/6 - 1/(6π); about an edge of two half discs 1/8, and in both
    λ2 = λ3."""
    points, corners = grid_cube(25)
    places = np.concatenate([corners[:1], [[0.5, 0.5, 0], [0.5, 0, 0]]])
    at = np.linalg.norm(points[:, None] - places, axis=2).argmin(axis=0)
    np.testing.assert_allclose(iss(points, 0.3, 1.01, 1.01, 5)[at], [1 / 6 - 1 / (6 * np.pi), 1 / 8, 0], atol=0.02)
    assert (iss(points, 0.3, 0.9, 0.9, 5)[at] == 0).all(), (
        "axes that are not distinct: a cube's own corners are none of ISS's keypoints"
    )


def test_iss_needs_neighbours_and_knows_no_unit() -> None:
    points = hills()
    assert not iss(points, 0.1, 0.975, 0.975, 10_000).any()
    assert (iss(points, 0.1, 0.8, 0.8, 5) > 0).sum() < (iss(points, 0.1, 1, 1, 5) > 0).sum()
    np.testing.assert_allclose(iss(points * 2, 0.2, 1, 1, 5), iss(points, 0.1, 1, 1, 5), atol=1e-9)


def test_sift_finds_a_spot_at_its_own_scale() -> None:
    """A Gaussian spot of deviation s, blurred by σ, is s² / (s² + σ²) high: it falls fastest, in log σ, at σ = s."""
    line = np.linspace(-0.5, 0.5, 51)
    points = np.stack([*(axis.ravel() for axis in np.meshgrid(line, line)), np.zeros(51 * 51)], axis=1)
    sigmas = 0.025 * 2 ** (np.arange(11) / 3)
    for spot in (0.05, 0.08):
        strength = extrema(points, np.exp(-(points**2).sum(axis=1) / (2 * spot**2)), sigmas)
        level, point = np.unravel_index(strength.argmax(), strength.shape)
        assert np.linalg.norm(points[point]) < 1e-9
        assert abs(np.log2(np.sqrt(sigmas[level + 1] * sigmas[level + 2]) / spot)) < 0.5 / 3 + 1e-6
        assert strength.max() == pytest.approx(
            abs(np.diff(spot**2 / (spot**2 + sigmas[level + 1 : level + 3] ** 2))[0]), rel=0.03
        )
