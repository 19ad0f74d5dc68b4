"""The camera convention of schemas/views.py: identities, round trips, and where things must appear."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from b23d.stages.geometry.cameras import (
    CLEARANCE,
    fibonacci_angles,
    fitting_distance,
    look_at_origin,
    pinhole,
    pixel_rays,
    project,
    ring_angles,
    rotations,
)
from tests.unprojecting import unproject

coordinates = st.floats(-0.5, 0.5, width=32)
clouds = arrays(np.float64, st.tuples(st.integers(1, 20), st.just(3)), elements=coordinates)


@pytest.mark.parametrize("rings", [1, 2, 3, 5, 8])
def test_rings_give_the_papers_number_of_views(rings: int) -> None:
    angles = ring_angles(rings)
    assert len(angles) == 2 * rings * (rings + 1) + 2
    assert len(np.unique(np.round(rotations(angles), 9), axis=0)) == len(angles)


def test_sixty_two_views_are_thirty_degrees_apart() -> None:
    angles = np.rad2deg(ring_angles(5))
    assert angles[0, 1] == 90
    assert angles[-1, 1] == -90
    np.testing.assert_allclose(np.unique(np.round(angles[1:-1, 1], 9)), [-60, -30, 0, 30, 60], atol=1e-9)
    np.testing.assert_allclose(np.diff(np.unique(np.round(angles[1:-1, 0], 9))), 30)


@pytest.mark.parametrize("count", [1, 2, 62, 500])
def test_fibonacci_views_spread_over_the_sphere(count: int) -> None:
    towards_camera = -rotations(fibonacci_angles(count))[:, 2]
    assert len(towards_camera) == count
    if count >= 62:
        np.testing.assert_allclose(towards_camera.mean(axis=0), 0, atol=0.01)
        nearest = np.sort(np.arccos(np.clip(towards_camera @ towards_camera.T, -1, 1)), axis=1)[:, 1]
        ideal = np.sqrt(4 * np.pi / count)  # side of the square per view
        assert nearest.min() > 0.7 * ideal
        assert nearest.max() < 1.3 * ideal


@given(arrays(np.float64, (4, 2), elements=st.floats(-7, 7)))
def test_rotations_are_rotations_and_look_at_the_origin(angles: np.ndarray) -> None:
    matrices = rotations(angles)
    np.testing.assert_allclose(matrices @ matrices.transpose(0, 2, 1), np.tile(np.eye(3), (4, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(matrices), 1)
    pixels, depth = project(np.zeros((1, 3)), look_at_origin(angles, 2.5), pinhole(100, 40))
    np.testing.assert_allclose(pixels, 50, atol=1e-9)
    np.testing.assert_allclose(depth, 2.5)


def test_right_is_right_and_up_is_up() -> None:
    front = look_at_origin(np.array([[0.0, 0.0]]), 2.0)  # at +z, looking along -z
    (centre, right, up, _), depth = (
        a[0] for a in project(np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]), front, pinhole(224, 60))
    )
    assert right[0] > centre[0]
    assert right[1] == pytest.approx(centre[1])
    assert up[1] < centre[1], "y of a pixel grows downwards"
    assert depth[3] == pytest.approx(1.9)
    # a quarter turn of azimuth puts the camera at +x: what is at +x comes near
    side = project(np.array([[0.1, 0, 0]]), look_at_origin(np.array([[np.pi / 2, 0.0]]), 2.0), pinhole(224, 60))[1]
    assert side == pytest.approx(1.9)


def test_top_and_bottom_continue_their_meridian() -> None:
    for sign in (1, -1):
        pole, nearly = rotations(np.array([[0.3, sign * np.pi / 2], [0.3, sign * (np.pi / 2 - 1e-6)]]))
        np.testing.assert_allclose(pole, nearly, atol=2e-6)


@given(clouds, st.integers(1, 4), st.floats(1.5, 10), st.floats(5, 150))
def test_unproject_inverts_project(points: np.ndarray, rings: int, distance: float, field_of_view: float) -> None:
    cameras, intrinsics = look_at_origin(ring_angles(rings), distance), pinhole(224, field_of_view)
    pixels, depth = project(points, cameras, intrinsics)
    back = unproject(pixels, depth, cameras, intrinsics)
    np.testing.assert_allclose(back, np.broadcast_to(points, back.shape), atol=1e-9)
    again, depth_again = project(back, cameras, intrinsics)
    np.testing.assert_allclose(again, pixels, atol=1e-6)
    np.testing.assert_allclose(depth_again, depth, atol=1e-9)


def test_points_behind_the_camera_have_no_depth() -> None:
    assert project(np.array([[0, 0, 3.0]]), look_at_origin(np.zeros((1, 2)), 2.0), pinhole(10, 60))[1] < 0


def test_pixel_rays_go_through_the_centres() -> None:
    intrinsics = pinhole(8, 60)
    rays = pixel_rays(intrinsics, 8)
    np.testing.assert_allclose(rays[..., 2], 1)
    pixels = (rays @ intrinsics.T)[..., :2]
    np.testing.assert_allclose(pixels[2, 5], [5.5, 2.5])  # row 2, column 5


@given(clouds, st.floats(20, 100), st.floats(0, 0.5))
def test_the_fitting_distance_is_the_least(points: np.ndarray, field_of_view: float, margin: float) -> None:
    angles, resolution = ring_angles(2), 100
    distance = fitting_distance(points, angles, field_of_view, margin)
    pixels, depth = project(points, look_at_origin(angles, distance), pinhole(resolution, field_of_view))
    off_centre = np.abs(pixels / resolution * 2 - 1).max()
    assert depth.min() >= CLEARANCE - 1e-9
    assert off_centre <= 1 - margin + 1e-6
    touches_frame = off_centre == pytest.approx(1 - margin, abs=1e-6)
    touches_clearance = depth.min() == pytest.approx(CLEARANCE, abs=1e-9)
    assert touches_frame or touches_clearance
