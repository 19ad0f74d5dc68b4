"""Back-projection against analytic visibility and exactly known token fields."""

from __future__ import annotations

from functools import cache
from typing import TypeVar

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.schemas.features import PointFeatures
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.views import Views, ViewTokens
from b23d.stages.backproject import BackprojectParams, backproject
from b23d.stages.encoders.patches import nearest_kept
from b23d.stages.extract import ExtractParams, extract
from b23d.stages.geometry.cameras import project
from b23d.stages.render import RenderParams, render
from b23d.stages.renderers.visibility import by_depth, by_face


def shape(
    vertices: np.ndarray, faces: np.ndarray, points: np.ndarray, point_faces: np.ndarray | None = None
) -> NormalizedShape:
    return NormalizedShape(
        kind="mesh" if len(faces) else "cloud",
        vertices=np.asarray(vertices, np.float32),
        faces=np.asarray(faces, np.int32).reshape(-1, 3),
        points=np.asarray(points, np.float32),
        point_faces=np.asarray(np.full(len(points), -1) if point_faces is None else point_faces, np.int32),
        point_barycentrics=np.zeros((len(points), 3), np.float32),
        candidates="fps",
        center=(0, 0, 0),
        scale=1,
        repairs={},
    )


def sampled(mesh: trimesh.Trimesh, count: int = 500) -> NormalizedShape:
    points, point_faces = trimesh.sample.sample_surface(mesh, count, seed=0)
    return shape(mesh.vertices, mesh.faces, points, point_faces)


def token_views(tokens: np.ndarray, class_tokens: np.ndarray | None = None) -> ViewTokens:
    kept = np.ones(tokens.shape[:3], bool)
    return ViewTokens(
        tokens=tokens.reshape(-1, tokens.shape[-1]).astype(np.float16),
        rows=nearest_kept(kept),
        kept=kept,
        class_tokens=class_tokens,
        encoder="test",
        weights="none",
    )


def noise(views: Views, channels: int = 5, grid: int = 7) -> ViewTokens:
    random = np.random.default_rng(0)
    count = len(views.depth)
    return token_views(
        random.normal(size=(count, grid, grid, channels)), random.normal(size=(count, channels)).astype(np.float16)
    )


def seen(of: NormalizedShape, views: Views, tolerance: float = 0.0025) -> np.ndarray:
    return by_depth(*project(of.points.astype(float), views.world_to_camera, views.intrinsics), views.depth, tolerance)


Of = TypeVar("Of", Views, ViewTokens)
SQUARE = np.array([[-0.5, 0, -0.5], [0.5, 0, -0.5], [0.5, 0, 0.5], [-0.5, 0, 0.5]])
SQUARE_FACES = np.array([[0, 1, 2], [0, 2, 3]])
TOP, BOTTOM = 0, -1


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


def test_constant_tokens_give_constant_features() -> None:
    mesh = sampled(trimesh.creation.torus(0.35, 0.15))
    views = render(mesh, RenderParams(rings={"count": 2}))
    tokens = token_views(np.broadcast_to([1.5, -2, 0.25], (len(views.depth), 16, 16, 3)))
    for sample in ("nearest", "bilinear"):
        result = backproject(mesh, views, tokens, BackprojectParams(sample=sample))
        assert result.observed.mean() > 0.99
        np.testing.assert_array_equal(
            result.features[result.observed], np.tile([1.5, -2, 0.25], (result.observed.sum(), 1))
        )


@pytest.mark.parametrize("grid", [(16, 16), (7, 9)])
def test_a_linear_ramp_is_reproduced(grid: tuple[int, int]) -> None:
    """Token values that are the pixel coordinates of their centres: bilinear sampling returns each point's own
    pixel."""
    mesh = sampled(trimesh.creation.box((0.6, 0.5, 0.4)))
    views = render(mesh, RenderParams(rings={"count": 1}, distance=2.0))
    rows, columns = ((np.arange(n) + 0.5) * 224 / n for n in grid)
    ramp = np.stack(np.meshgrid(columns, rows), axis=-1)
    visible = seen(mesh, views)
    pixels, _ = project(mesh.points.astype(float), views.world_to_camera, views.intrinsics)
    expected = (pixels * visible[..., None]).sum(axis=0) / visible.sum(axis=0)[:, None]
    tokens = token_views(np.broadcast_to(ramp, (len(views.depth), *ramp.shape)))
    smooth = backproject(mesh, views, tokens, BackprojectParams()).features
    np.testing.assert_allclose(smooth, expected, atol=0.13)  # float16's spacing at 224 is .125
    nearest = backproject(mesh, views, tokens, BackprojectParams(sample="nearest")).features
    assert np.abs(nearest - expected).max() <= 224 / min(grid) / 2 + 0.13
    assert np.abs(nearest - expected).mean() > 1


def test_nearest_takes_the_token_of_the_patch() -> None:
    point = np.array([[0.2, 0, 0.1]])
    plane = shape(SQUARE, SQUARE_FACES, point)
    views = render(plane, RenderParams(rings={"count": 1}, distance=2.0))
    patch = np.zeros((len(views.depth), 8, 8, 1))
    pixel = project(point, views.world_to_camera, views.intrinsics)[0][TOP, 0]
    patch[TOP, int(pixel[1] // 28), int(pixel[0] // 28)] = 1
    result = backproject(plane, views, token_views(patch), BackprojectParams(sample="nearest"))
    assert result.features[0, 0] * result.counts[0] == pytest.approx(1, abs=1e-3)


def test_a_single_token_per_view() -> None:
    mesh = sampled(trimesh.creation.icosphere(radius=0.5))
    views = render(mesh, RenderParams(rings={"count": 1}))
    for sample in ("nearest", "bilinear"):
        result = backproject(
            mesh, views, token_views(np.ones((len(views.depth), 1, 1, 2))), BackprojectParams(sample=sample)
        )
        assert (result.features == 1).all()


def test_counts_times_features_is_the_sum() -> None:
    mesh = sampled(trimesh.creation.torus(0.35, 0.15))
    views = render(mesh, RenderParams(rings={"count": 2}))
    tokens = noise(views)
    whole = backproject(mesh, views, tokens, BackprojectParams(sample="nearest"))
    pixels, _ = project(mesh.points.astype(float), views.world_to_camera, views.intrinsics)
    visible = seen(mesh, views)
    column, row = np.moveaxis((pixels // 32).astype(int), 2, 0)
    picked = tokens.grid()[np.arange(len(visible))[:, None], row, column].astype(float) * visible[..., None]
    np.testing.assert_allclose(whole.features * whole.counts[:, None].astype(float), picked.sum(axis=0), atol=0.02)
    np.testing.assert_array_equal(whole.observed, whole.counts > 0)
    assert whole.class_token is not None
    np.testing.assert_allclose(whole.class_token, np.asarray(tokens.class_tokens, float).mean(axis=0), rtol=1e-5)
    assert whole.descriptor == "test"


@cache
def small_torus() -> tuple[NormalizedShape, Views, ViewTokens]:
    mesh = sampled(trimesh.creation.torus(0.35, 0.15), 200)
    views = render(mesh, RenderParams(rings={"count": 2}, resolution=64))
    return mesh, views, noise(views)


@settings(max_examples=10, deadline=None)
@given(st.permutations(range(14)))
def test_the_order_of_views_does_not_matter(order: list[int]) -> None:
    mesh, views, tokens = small_torus()
    a = backproject(mesh, views, tokens, BackprojectParams())
    b = backproject(mesh, permuted(views, order), permuted(tokens, order), BackprojectParams())
    close(a, b)


def permuted(of: Of, order: list[int]) -> Of:
    return of.model_copy(
        update={
            name: value[order]
            for name, value in of.present_arrays().items()
            if of.array_specs()[name].dims.startswith("view ")
        }
    )


def close(a: PointFeatures, b: PointFeatures) -> None:
    np.testing.assert_array_equal(a.counts, b.counts)
    np.testing.assert_allclose(a.features, b.features, atol=2e-3)


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


def test_tokens_of_other_views_are_an_error() -> None:
    mesh = sampled(trimesh.creation.icosphere(radius=0.5))
    views = render(mesh, RenderParams(rings={"count": 1}))
    with pytest.raises(ValueError, match="tokens: expected those of 6 views, got 5"):
        backproject(mesh, views, token_views(np.ones((5, 2, 2, 1))), BackprojectParams())


def test_features_do_not_depend_on_the_renderer() -> None:
    """A real encoder on both renderers' pictures: cosine > .99 at (almost) every point."""
    mesh = sampled(
        trimesh.util.concatenate(
            [
                trimesh.creation.torus(0.35, 0.1),
                trimesh.creation.box((0.2, 0.5, 0.9)),
                trimesh.creation.cylinder(0.05, 1.0),
            ]
        )
    )
    features = []
    for name in ("embree", "pyrender"):
        try:
            views = render(mesh, RenderParams(renderer=name, rings={"count": 1}, azimuth_offset=10))
            tokens = extract(views, ExtractParams(encoder="efficientnet-lite0"))
        except (RuntimeError, FileNotFoundError) as error:
            pytest.skip(str(error))
        features.append(backproject(mesh, views, tokens, BackprojectParams()).features.astype(float))
    a, b = features
    both = a.any(axis=1) & b.any(axis=1)
    cosine = np.einsum("nc,nc->n", a[both], b[both]) / np.linalg.norm(a[both], axis=1) / np.linalg.norm(b[both], axis=1)
    assert cosine.mean() > 0.998
    assert np.quantile(cosine, 0.01) > 0.99
