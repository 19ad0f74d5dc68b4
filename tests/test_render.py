"""Rendering against what geometry says must be seen, and the two renderers against each other."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh

from b23d.schemas.shape import NormalizedShape
from b23d.schemas.views import Views
from b23d.stages.geometry.cameras import project
from b23d.stages.render import RenderParams, render
from b23d.stages.renderers import RendererName, renderer
from tests.unprojecting import unproject

FEW = {"rings": {"count": 1}}  # six views: top, four sides, bottom
RENDERERS = [pytest.param("embree"), pytest.param("pyrender")]


def shape(vertices: np.ndarray, faces: np.ndarray | None = None, **more: object) -> NormalizedShape:
    """A mesh, or a cloud where there are no faces; candidates are its first vertices."""
    vertices = np.asarray(vertices, np.float32)
    points = vertices[:50]
    return NormalizedShape.model_validate(
        {
            "kind": "cloud" if faces is None else "mesh",
            "vertices": vertices,
            "faces": np.zeros((0, 3), np.int32) if faces is None else np.asarray(faces, np.int32),
            "points": points,
            "point_faces": np.full(len(points), -1, np.int32),
            "point_barycentrics": np.zeros((len(points), 3), np.float32),
            "candidates": "cloud",
            "center": (0.0, 0.0, 0.0),
            "scale": 1.0,
            "repairs": {},
            **more,
        }
    )


@cache
def sphere() -> NormalizedShape:
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.5)
    return shape(mesh.vertices, mesh.faces)


def box(*sides: float) -> NormalizedShape:
    mesh = trimesh.creation.box(sides)
    return shape(mesh.vertices, mesh.faces)


def soup(seed: int, count: int = 60) -> NormalizedShape:
    """Triangles that cross each other, of both orientations."""
    corners = np.random.default_rng(seed).uniform(-0.5, 0.5, (count, 3, 3))
    return shape(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def needs(name: RendererName) -> None:
    """Skips where this machine cannot run the renderer (pyrender without EGL)."""
    try:
        renderer(name)(np.eye(3, dtype=np.float32), np.array([[0, 1, 2]]), np.eye(4)[None], np.eye(3), 4)
    except RuntimeError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("name", RENDERERS)
def test_a_sphere_is_a_disc(name: RendererName) -> None:
    needs(name)
    views = render(sphere(), RenderParams(renderer=name, **FEW))
    focal, distance = views.intrinsics[0, 0], views.distance
    seen = views.face_ids >= 0
    radius = focal * 0.5 / np.sqrt(distance**2 - 0.5**2)  # of its outline, in pixels
    np.testing.assert_allclose(seen.sum(axis=(1, 2)), np.pi * radius**2, rtol=0.01)
    np.testing.assert_allclose(
        views.depth.max(axis=(1, 2), where=seen, initial=0), distance - 0.5**2 / distance, rtol=0.02
    )
    np.testing.assert_allclose(views.depth[:, 112, 112], distance - 0.5, atol=1e-3)
    assert (views.depth[~seen] == 0).all()
    assert (views.images[~seen] == 255).all()
    assert (np.abs(views.images[:, 112, 112].astype(int) - 178) <= 1).all(), "grey .7 where it faces the camera"
    assert views.images[seen].max() <= 179


@pytest.mark.parametrize("name", RENDERERS)
@pytest.mark.parametrize("seed", range(3))
def test_every_pixel_lies_on_the_face_it_names(name: RendererName, seed: int) -> None:
    needs(name)
    triangles = soup(seed)
    views = render(triangles, RenderParams(renderer=name, resolution=64, **FEW))
    view, row, column = np.nonzero(views.face_ids >= 0)
    seen = np.stack([column + 0.5, row + 0.5], axis=1)
    points = np.stack(
        [
            unproject(
                seen[None, [i]],
                views.depth[None, view[[i]], row[i], column[i]],
                views.world_to_camera[[v]],
                views.intrinsics,
            )[0, 0]
            for i, v in enumerate(view[:500])
        ]
    )
    corners = triangles.vertices[triangles.faces[views.face_ids[view, row, column][:500]]].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    heights = np.einsum("pi,pi->p", points - corners[:, 0], normals)
    np.testing.assert_allclose(heights, 0, atol=2e-6)


@pytest.mark.parametrize("make", [sphere, lambda: box(1, 0.6, 0.4), lambda: soup(0), lambda: soup(1, 400)])
def test_renderers_agree(make: object) -> None:
    needs("pyrender")
    mesh = make()  # type: ignore[operator]
    rays, raster = (render(mesh, RenderParams(renderer=name, **FEW)) for name in ("embree", "pyrender"))
    agree(rays, raster)
    assert (rays.face_ids == raster.face_ids).mean() > 0.999


def test_renderers_agree_on_a_cloud() -> None:
    needs("pyrender")
    cloud = shape(trimesh.sample.sample_surface(trimesh.creation.torus(0.35, 0.15), 1500, seed=0)[0])
    agree(*(render(cloud, RenderParams(renderer=name, **FEW)) for name in ("embree", "pyrender")))


def agree(a: Views, b: Views) -> None:
    """Silhouettes, depths inside them, and pictures."""
    in_a, in_b = a.face_ids >= 0, b.face_ids >= 0
    overlap = (in_a & in_b).sum(axis=(1, 2)) / (in_a | in_b).sum(axis=(1, 2))
    assert overlap.min() > 0.99
    difference = np.abs(a.depth - b.depth)[in_a & in_b]
    assert np.quantile(difference, 0.995) < 1e-4
    levels = np.abs(a.images.astype(int) - b.images.astype(int))
    assert (levels > 1).mean() < 0.005


def test_the_shape_fills_the_frame_and_stays_inside() -> None:
    views = render(box(1, 0.3, 0.2), RenderParams(margin=0.1))
    pixels, _ = project(box(1, 0.3, 0.2).vertices.astype(float), views.world_to_camera, views.intrinsics)
    assert np.abs(pixels / 112 - 1).max() == pytest.approx(0.9, abs=1e-6)
    assert (views.face_ids[:, [0, -1]] == -1).all()
    assert (views.face_ids[:, :, [0, -1]] == -1).all()


def test_a_distance_that_is_too_small_is_an_error() -> None:
    fitted = render(box(1, 1, 1), RenderParams(margin=0, **FEW)).distance
    with pytest.raises(ValueError, match=r"distance: expected at least \d.*got 1\.0; raise it"):
        render(box(1, 1, 1), RenderParams(distance=1.0, **FEW))
    assert render(box(1, 1, 1), RenderParams(distance=fitted + 1e-9, **FEW)).distance == pytest.approx(fitted)
    assert render(box(1, 1, 1), RenderParams(distance_factor=2, margin=0, **FEW)).distance == pytest.approx(2 * fitted)


def test_orientation_does_not_matter() -> None:
    mesh = sphere()
    inside_out = shape(mesh.vertices, mesh.faces[:, ::-1])
    mixed = shape(mesh.vertices, np.where(np.arange(len(mesh.faces))[:, None] % 2, mesh.faces, mesh.faces[:, ::-1]))
    for shading, other in (("flat", inside_out), ("flat", mixed), ("smooth", inside_out)):
        a, b = (
            render(m, RenderParams(shading=shading, resolution=64, **FEW)).images.astype(int) for m in (mesh, other)
        )
        assert np.abs(a - b).max() <= 1, shading


def test_light_falls_off_with_the_cosine() -> None:
    """On a sphere n·l is known at every pixel; smooth normals come nearer to it than flat ones."""
    coarse = trimesh.creation.icosphere(subdivisions=2, radius=0.5)
    errors = {}
    for shading in ("flat", "smooth"):
        views = render(
            shape(coarse.vertices, coarse.faces), RenderParams(shading=shading, ambient=0.2, albedo=0.5, **FEW)
        )
        row, column = np.nonzero(views.face_ids[1] >= 0)
        pixels = np.stack([column + 0.5, row + 0.5], axis=1)[None]
        points = unproject(pixels, views.depth[1][None, row, column], views.world_to_camera[[1]], views.intrinsics)[0]
        camera = np.linalg.inv(views.world_to_camera[1])[:3, 3]
        to_light = (camera - points) / np.linalg.norm(camera - points, axis=1, keepdims=True)
        cosine = np.einsum("pi,pi->p", points / np.linalg.norm(points, axis=1, keepdims=True), to_light)
        expected = 255 * 0.5 * (0.2 + 0.8 * np.abs(cosine))
        errors[shading] = np.abs(views.images[1, row, column, 0] - expected).mean()
    assert errors["flat"] < 8
    assert errors["smooth"] < errors["flat"] / 2


def test_turning_the_cameras_is_turning_the_shape() -> None:
    mesh = soup(3)
    turn = trimesh.transformations.rotation_matrix(np.deg2rad(-20), [0, 1, 0])[:3, :3]
    turned = shape(mesh.vertices @ turn.T, mesh.faces)
    a = render(mesh, RenderParams(azimuth_offset=20, **FEW))
    b = render(turned, RenderParams(**FEW))
    assert a.distance == pytest.approx(b.distance, abs=1e-6)
    assert (a.face_ids == b.face_ids).mean() > 0.999


def test_fibonacci_has_as_many_views_as_asked() -> None:
    assert len(render(box(1, 1, 1), RenderParams(layout="fibonacci", fibonacci={"views": 7}, resolution=16)).depth) == 7
    assert len(render(box(1, 1, 1), RenderParams(layout="fibonacci", resolution=16)).depth) == 62


def quad() -> tuple[np.ndarray, np.ndarray]:
    """A unit square in the plane z = 0, seen upright from the front (view 1 of one ring)."""
    return np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]]), np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize("name", RENDERERS)
def test_textures_and_colours_appear_where_they_belong(name: RendererName) -> None:
    needs(name)
    vertices, faces = quad()
    colors = np.array(
        [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0]], np.uint8
    )  # from the lower left, counter-clockwise
    texture = np.kron(colors[[3, 2, 0, 1]].reshape(2, 2, 3), np.ones((64, 64, 1), np.uint8))  # row 0 is on top
    uvs = (vertices[faces][..., :2] + 0.5).astype(np.float32)
    textured = shape(vertices, faces, face_uvs=uvs, texture=texture)
    colored = shape(vertices, faces, vertex_colors=colors)
    for of in (textured, colored):
        views = render(of, RenderParams(texture=True, ambient=1, renderer=name, **FEW))
        pixels, _ = project(0.96 * vertices, views.world_to_camera[[1]], views.intrinsics)
        column, row = pixels[0].astype(int).T
        np.testing.assert_allclose(views.images[1, row, column], colors, atol=25)
        grey = render(of, RenderParams(ambient=1, renderer=name, **FEW)).images[1]
        assert set(np.unique(grey)) == {178, 255}


def test_a_fine_texture_does_not_alias() -> None:
    vertices, faces = quad()
    checks = np.repeat((np.indices((512, 512)).sum(axis=0) % 2 * 255).astype(np.uint8)[..., None], 3, axis=2)
    fine = shape(vertices, faces, face_uvs=(vertices[faces][..., :2] + 0.5).astype(np.float32), texture=checks)
    image = render(fine, RenderParams(texture=True, ambient=1, resolution=64, **FEW)).images[1, 20:44, 20:44]
    assert (np.abs(image.astype(int) - 128) <= 2).all()


def test_a_cloud_looks_like_the_surface_it_was_sampled_from() -> None:
    solid = trimesh.creation.box((1, 0.5, 0.4)).subdivide()
    mesh = shape(solid.vertices, solid.faces)
    cloud = shape(trimesh.sample.sample_surface(solid, 2048, seed=1)[0])
    params = RenderParams(distance=1.5, rings={"count": 2})
    a, b = render(mesh, params), render(cloud, params)
    in_a, in_b = a.face_ids >= 0, b.face_ids >= 0
    assert (in_a & in_b).sum() / (in_a | in_b).sum() > 0.95
    assert (in_b & ~in_a).sum() / in_a.sum() < 0.02, "not fattened"
    both = in_a & in_b
    assert np.median(np.abs(a.depth - b.depth)[both]) < 1e-3
    assert np.median(np.abs(a.images.astype(int) - b.images.astype(int))[both]) <= 2


def test_thin_sheets_stay_apart_and_thin() -> None:
    """Two parallel sheets .01 apart, some half of the points' spacing: seen edge-on they stay about that thin."""
    random = np.random.default_rng(0)
    sheets = np.concatenate([np.c_[random.uniform(-0.5, 0.5, (1024, 2)), np.full(1024, z)] for z in (-0.005, 0.005)])
    views = render(shape(sheets), RenderParams(distance=1.5, **FEW))
    side = views.face_ids[2] >= 0  # azimuth 90°: along the sheets
    wide = side.sum(axis=1)[20:-20]
    pixel = 1.0 / views.intrinsics[0, 0]  # at the near border, of depth 1
    assert np.quantile(wide[wide > 0], 0.9) * pixel < 0.02
    front = views.images[1][views.face_ids[1] >= 0]
    assert np.median(front) >= 170


def test_a_clouds_ids_are_its_points() -> None:
    points = trimesh.creation.icosphere(subdivisions=3, radius=0.5).vertices
    views = render(shape(points), RenderParams(**FEW))
    row, column = np.nonzero(views.face_ids[1] >= 0)
    pixels = np.stack([column + 0.5, row + 0.5], axis=1)[None]
    seen = unproject(pixels, views.depth[1][None, row, column], views.world_to_camera[[1]], views.intrinsics)[0]
    assert views.face_ids.max() < len(points)
    assert np.linalg.norm(points[views.face_ids[1, row, column]] - seen, axis=1).max() < 0.2


def test_cloud_colours() -> None:
    points = trimesh.creation.icosphere(subdivisions=3, radius=0.5).vertices
    colors = np.where(points[:, :1] > 0, [[255, 0, 0]], [[0, 0, 255]]).astype(np.uint8)
    views = render(shape(points, vertex_colors=colors), RenderParams(texture=True, ambient=1, **FEW))
    np.testing.assert_array_equal(views.images[1, 112, 180], [255, 0, 0])
    np.testing.assert_array_equal(views.images[1, 112, 44], [0, 0, 255])


def test_odd_clouds_render() -> None:
    line = np.c_[np.linspace(-0.5, 0.5, 40), np.zeros((40, 2))]
    repeated = np.repeat(np.random.default_rng(0).uniform(-0.5, 0.5, (30, 3)), 4, axis=0)
    for points in (line, repeated, np.random.default_rng(1).uniform(-0.5, 0.5, (4, 3))):
        views = render(shape(points), RenderParams(resolution=32, **FEW))
        assert np.isfinite(views.depth).all()
    with pytest.raises(ValueError, match="point cloud: expected at least 4 points"):
        render(shape(points[:3]), RenderParams(**FEW))


def test_a_mesh_without_faces_is_an_error() -> None:
    with pytest.raises(ValueError, match="mesh: expected faces to render, got none"):
        render(shape(np.zeros((3, 3)), np.zeros((0, 3))), RenderParams(**FEW))


def test_the_same_twice() -> None:
    cloud = shape(np.random.default_rng(0).normal(0, 0.2, (500, 3)))
    for of in (soup(2), cloud):
        a, b = (render(of, RenderParams(**FEW)) for _ in range(2))
        for name, value in a.present_arrays().items():
            np.testing.assert_array_equal(value, getattr(b, name))
