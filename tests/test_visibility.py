"""Which candidates a view sees, against what geometry says."""

from __future__ import annotations

import numpy as np
import trimesh

from b23d.stages.backproject import BackprojectParams, backproject
from b23d.stages.geometry.cameras import project
from b23d.stages.render import RenderParams, render
from b23d.stages.renderers.visibility import by_face
from tests.made_tokens import BOTTOM, SQUARE, SQUARE_FACES, TOP, noise, sampled, seen, shape


def test_a_plane_is_seen_from_above_and_below_at_the_pixels_geometry_says() -> None:
    grid = np.stack(np.meshgrid(np.linspace(-0.45, 0.45, 9), [0.0], np.linspace(-0.45, 0.45, 9)), axis=-1).reshape(
        -1, 3
    )
    plane = shape(SQUARE, SQUARE_FACES, grid)
    views = render(plane, RenderParams(distance=2.0))
    pixels, depth = project(grid, views.world_to_camera, views.intrinsics)
    focal = views.intrinsics[0, 0]
    # from the top, with azimuth 0, +x is right and +z is down
    np.testing.assert_allclose(pixels[TOP], 112 + focal * grid[:, [0, 2]] / 2, atol=1e-9)
    np.testing.assert_allclose(depth[TOP], 2)
    visible = seen(plane, views)
    steep = np.abs(views.world_to_camera[:, 2, 1]) > 0.1  # all but the ring that looks along the plane
    assert visible[steep].all()
    result = backproject(plane, views, noise(views), BackprojectParams())
    np.testing.assert_array_equal(result.counts, visible.sum(axis=0))


def test_a_point_of_a_sphere_is_seen_where_it_faces_the_camera() -> None:
    """It does where n·v > r / d, v the direction of the camera: apart from a narrow band at the outline."""
    ball = sampled(trimesh.creation.icosphere(subdivisions=5, radius=0.5), 2000)
    views = render(ball, RenderParams(resolution=224))
    to_camera = -views.world_to_camera[:, 2, :3]
    cosine = to_camera @ ball.points.T.astype(float) / 0.5
    limit = 0.5 / views.distance
    visible = seen(ball, views, tolerance=0.002)
    assert visible[cosine > limit + 0.06].all()
    assert not visible[cosine < limit - 0.1].any()
    assert visible[cosine > limit].mean() > 0.98
    assert (visible == (cosine > limit)).mean() > 0.97


def test_what_is_in_front_hides() -> None:
    """A square under a smaller one: from the top its middle is hidden, from the bottom nothing is."""
    above = SQUARE * 0.5 + np.array([0, 0.3, 0])
    random = np.random.default_rng(1).uniform(-0.49, 0.49, (400, 2))
    points = np.c_[random[:, 0], np.zeros(400), random[:, 1]]
    both = shape(np.concatenate([SQUARE, above]), np.concatenate([SQUARE_FACES, SQUARE_FACES + 4]), points)
    views = render(both, RenderParams(distance=2.0, rings={"count": 1}))
    visible = seen(both, views)
    shadow = 0.25 * 2.0 / 1.7  # half side of the upper square's outline on the lower one
    away = np.abs(points[:, [0, 2]]).max(axis=1)
    assert not visible[TOP][away < shadow - 0.01].any()
    assert visible[TOP][away > shadow + 0.01].all()
    assert visible[BOTTOM].all()


def test_coincident_double_faces_do_not_hide_each_other() -> None:
    single = sampled(trimesh.Trimesh(SQUARE, SQUARE_FACES, process=False))
    double = shape(np.tile(SQUARE, (2, 1)), np.concatenate([SQUARE_FACES, SQUARE_FACES[:, ::-1] + 4]), single.points)
    params = RenderParams(rings={"count": 3})
    np.testing.assert_array_equal(seen(single, render(single, params)), seen(double, render(double, params)))


def test_sheets_further_apart_than_the_tolerance_do() -> None:
    gap = 0.01
    points = np.array([[0.1, 0, 0.1], [0.1, gap, 0.1]])
    lifted = SQUARE + np.array([0, gap, 0])
    both = shape(np.concatenate([SQUARE, lifted]), np.concatenate([SQUARE_FACES, SQUARE_FACES + 4]), points)
    views = render(both, RenderParams(rings={"count": 1}))
    assert seen(both, views)[[TOP, BOTTOM]].tolist() == [[False, True], [True, False]]
    assert seen(both, views, tolerance=2 * gap)[[TOP, BOTTOM]].all()


def test_nothing_is_seen_outside_of_the_frame_or_behind_the_camera() -> None:
    ball = sampled(trimesh.creation.icosphere(radius=0.5))
    views = render(ball, RenderParams(rings={"count": 1}))
    far = shape(ball.vertices, ball.faces, np.array([[5.0, 0, 0], [0, 5.0, 0], [0, 0, -5.0]]))
    visible = seen(far, views)
    towards = views.world_to_camera[:, 2, :3] @ far.points.T  # > 0: the camera looks that way, the ball is before it
    assert not visible.any(), towards
    result = backproject(far, views, noise(views), BackprojectParams())
    assert not result.observed.any()
    assert (result.features == 0).all()


def test_by_face_sees_whole_faces_their_ring_and_always_the_last() -> None:
    """A strip of squares: a view that shows face 2 sees the points of 0 … 4 (a corner in common); -1 stands for the
    last."""
    strip = np.array([[i, i + 1, i + 2] for i in range(20)])
    ids = np.array([[[2, 2], [2, 2]], [[-1, 2], [2, 2]]])
    visible = by_face(ids, strip, np.arange(20))
    np.testing.assert_array_equal(np.flatnonzero(visible[0]), np.arange(5))
    np.testing.assert_array_equal(np.flatnonzero(visible[1]), [0, 1, 2, 3, 4, 17, 18, 19])


def test_by_face_on_a_cloud_means_its_discs() -> None:
    points = trimesh.creation.icosphere(subdivisions=3, radius=0.5).vertices
    cloud = shape(points, np.zeros((0, 3)), points[::3])
    views = render(cloud, RenderParams(rings={"count": 1}))
    counts = backproject(cloud, views, noise(views), BackprojectParams(visibility="face")).counts
    expected = np.array([[np.isin(i, ids) for ids in views.face_ids] for i in range(0, len(points), 3)]).sum(axis=1)
    np.testing.assert_array_equal(counts[:-1], expected[:-1])
