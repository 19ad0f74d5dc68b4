"""describe: known spectra, invariance to rigid motion, scale and bending, and SHOT's frames and histograms."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from b23d.schemas.shape import NormalizedShape
from b23d.stages.datasets.procedural.isometric import isometric_cubes
from b23d.stages.describe import DescribeParams, describe
from b23d.stages.descriptors.shot import CHANNELS, local_frames, shot
from b23d.stages.descriptors.spectral import cloud_spectrum, heat_kernel_signature, mesh_spectrum, wave_kernel_signature
from b23d.stages.geodesics.shortcuts import face_normals
from tests.made_params import placed

TURN = Rotation.from_rotvec([0.4, -1.1, 2.0])
BUMPS = np.array([[0.9, 0.2, 0.1], [-0.5, 0.8, 0.2], [0.1, -0.3, -0.9]])


def shape(vertices: np.ndarray, faces: np.ndarray, at: np.ndarray, weights: np.ndarray) -> NormalizedShape:
    points = np.einsum("nc,ncx->nx", weights, vertices[faces[at]]) if len(faces) else vertices
    return NormalizedShape(
        kind="mesh" if len(faces) else "cloud",
        vertices=vertices.astype(np.float32),
        faces=faces.astype(np.int32),
        points=points.astype(np.float32),
        point_faces=at.astype(np.int32),
        point_barycentrics=weights.astype(np.float32),
        candidates="fps",
        center=(0.0, 0.0, 0.0),
        scale=1.0,
        repairs={},
    )


def spread(faces: np.ndarray, count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    return np.sort(rng.choice(len(faces), count)), rng.dirichlet([3, 3, 3], count)


def bumpy(count: int = 250) -> NormalizedShape:
    """A ball with three different bumps: no symmetry, unambiguous frames."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.4)
    vertices = np.asarray(ball.vertices)
    swell = sum(
        size * np.exp(-8 * ((vertices / 0.4 - bump) ** 2).sum(axis=1))
        for size, bump in zip((0.5, 0.3, 0.4), BUMPS, strict=True)
    )
    return shape(vertices * (1 + swell)[:, None], np.asarray(ball.faces), *spread(ball.faces, count))


def moved(of: NormalizedShape, scale: float = 1.0) -> NormalizedShape:
    return shape(TURN.apply(of.vertices) * scale, of.faces, of.point_faces, of.point_barycentrics)


def features(of: NormalizedShape, **params: object) -> np.ndarray:
    return describe(of, placed(DescribeParams, **params)).features.astype(np.float64)


# --- spectra


@pytest.mark.parametrize("on", ["mesh", "cloud"])
def test_the_sphere_has_its_known_spectrum_and_constant_signatures(on: str) -> None:
    """λ = 4 π l (l + 1) for unit area, 2 l + 1 times each; all points are alike."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    if on == "mesh":
        spectrum = mesh_spectrum(np.asarray(ball.vertices), ball.faces, *spread(ball.faces, 200), 49)
    else:
        spectrum = cloud_spectrum(np.asarray(ball.vertices), 49)
    degree = np.repeat(np.arange(7), 2 * np.arange(7) + 1)
    np.testing.assert_allclose(spectrum.values[1:], 4 * np.pi * (degree * (degree + 1))[1:], rtol=0.03)
    heat = heat_kernel_signature(spectrum, np.geomspace(0.02, 0.4, 8))
    np.testing.assert_allclose(heat, 1, atol=0.05)
    np.testing.assert_allclose(wave_kernel_signature(spectrum, 10, 2.0).mean(axis=0), 1, atol=0.05)


def test_coarse_meshes_resolve_as_much_as_their_points() -> None:
    """A unit square of two triangles: λ = π² (a² + b²), found at 500 points inserted into it."""
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    rng = np.random.default_rng(0)
    at, weights = np.repeat([0, 1], 250), rng.dirichlet([1, 1, 1], 500)
    values = mesh_spectrum(square, faces, at, weights, 6).values
    np.testing.assert_allclose(values, np.pi**2 * np.array([0, 1, 1, 2, 4, 4]), rtol=0.12, atol=1e-6)


@pytest.mark.parametrize("descriptor", ["hks", "wks"])
@pytest.mark.parametrize("surface", ["mesh", "cloud"])
def test_signatures_do_not_depend_on_frame_or_size(descriptor: str, surface: str) -> None:
    params = {"descriptor": descriptor, "surface": surface, "eigenpairs": 40}
    tolerance = 0.01 if surface == "mesh" else 0.15  # a cloud's local triangulations lean on the frame
    found, turned = (features(of, **params) for of in (bumpy(), moved(bumpy(), 3.0)))
    assert np.abs(turned - found).max() < tolerance * found.max()


def test_signatures_do_not_depend_on_bending() -> None:
    """A sheet and the same sheet rolled into half a tube."""
    grid = np.stack(np.meshgrid(np.linspace(0, 1, 41), np.linspace(0, 1, 21), indexing="ij"), axis=-1).reshape(-1, 2)
    corner = (np.arange(40)[:, None] * 21 + np.arange(20)).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 21, corner + 22], 1), np.stack([corner, corner + 22, corner + 1], 1)]
    )
    flat = np.column_stack([grid[:, 0], np.zeros(len(grid)), grid[:, 1]])
    angle = np.pi * grid[:, 0]
    rolled = np.column_stack([np.cos(angle) / np.pi, np.sin(angle) / np.pi, grid[:, 1]])
    where = spread(faces, 150)
    for descriptor in ("hks", "wks"):
        one, other = (features(shape(v, faces, *where), descriptor=descriptor, eigenpairs=40) for v in (flat, rolled))
        assert np.abs(one - other).max() < 0.03 * one.max()
    one, other = (features(shape(v, faces, *where), descriptor="shot") for v in (flat, rolled))
    assert np.abs(one - other).max() > 0.2


def test_isometric_cubes_differ_only_for_shot() -> None:
    cubes = isometric_cubes()
    where = spread(cubes[0].faces, 1500)
    inward, outward = (shape(cube.vertices - np.array([0, -0.5, 0]), cube.faces, *where) for cube in cubes)
    for descriptor in ("hks", "wks"):
        one, other = (features(of, descriptor=descriptor) for of in (outward, inward))
        np.testing.assert_allclose(one, other, atol=0.01 * one.max())
    one, other = (features(of, descriptor="shot") for of in (outward, inward))
    change = np.linalg.norm(one - other, axis=1)
    dent = np.linalg.norm(outward.points - [0, 0.5, 0], axis=1) < 0.25
    far = outward.points[:, 1] < 0
    assert change[dent].mean() > 0.5
    assert change[far].max() < 1e-3


def test_heat_finds_the_bumps() -> None:
    """After a short time more heat is left where the surface is curved: on the bumps."""
    ball = bumpy()
    heat = features(ball, descriptor="hks")[:, 4]
    out = np.linalg.norm(ball.points, axis=1) > 0.5
    assert heat[out].mean() > 1.2 * heat[~out].mean()


def test_unconnected_parts_are_described_on_the_cloud() -> None:
    ball = bumpy()
    apart = np.concatenate([ball.vertices, ball.vertices + np.array([0.9, 0, 0])])
    faces = np.concatenate([ball.faces, ball.faces + len(ball.vertices)])
    at = np.concatenate([ball.point_faces, ball.point_faces + len(ball.faces)])
    two = shape(apart, faces, at, np.tile(ball.point_barycentrics, (2, 1)))
    np.testing.assert_array_equal(features(two), features(two, surface="cloud"))
    assert (features(ball) != features(ball, surface="cloud")).any()


def test_two_runs_give_the_same_bytes() -> None:
    ball = bumpy()
    for descriptor in ("hks", "wks", "shot"):
        assert features(ball, descriptor=descriptor).tobytes() == features(ball, descriptor=descriptor).tobytes()


# --- SHOT


def test_shot_is_of_unit_length_and_does_not_depend_on_the_frame() -> None:
    for surface in ("mesh", "cloud"):
        found, turned = (
            features(of, descriptor="shot", radius=0.3, surface=surface) for of in (bumpy(), moved(bumpy()))
        )
        assert found.shape[1] == CHANNELS == 352
        np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, atol=2e-3)
        assert (found >= 0).all()
        assert np.median(np.abs(turned - found).max(axis=1)) < 2e-3
        assert (np.abs(turned - found).max(axis=1) < 0.02).mean() > 0.97  # a frame may flip where sides tie


def test_shot_with_exact_normals_does_not_depend_on_size() -> None:
    points = bumpy()
    normals = face_normals(points.vertices, points.faces)[points.point_faces]
    one, defined = shot(points.points, 0.3, normals)
    two, _ = shot(points.points * 2, 0.6, normals)
    assert defined.mean() > 0.99
    np.testing.assert_allclose(one, two, atol=1e-9)


def test_frames_are_right_handed_repeatable_and_turn_along() -> None:
    points = bumpy().points.astype(np.float64)

    def frames(of: np.ndarray) -> np.ndarray:
        pairs = cKDTree(of).query_pairs(0.3, output_type="ndarray")
        centers, others = np.concatenate([pairs, pairs[:, ::-1]]).T
        offsets = of[others] - of[centers]
        return local_frames(centers, offsets, np.linalg.norm(offsets, axis=1), 0.3, of - of.mean(axis=0))

    found = frames(points)
    np.testing.assert_allclose(found @ found.transpose(0, 2, 1), np.broadcast_to(np.eye(3), found.shape), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(found), 1)
    turned = frames(TURN.apply(points))
    agree = np.abs(turned - found @ TURN.as_matrix().T).max(axis=(1, 2)) < 1e-6
    assert agree.mean() > 0.97
    noisy = frames(points + np.random.default_rng(0).normal(scale=1e-3, size=points.shape))
    assert np.median(np.einsum("nax,nax->na", noisy, found)) > 0.99


def test_all_points_inside_a_flat_grid_look_alike() -> None:
    grid = np.stack(np.meshgrid(np.arange(30), [0], np.arange(30) * 1.1), axis=-1).reshape(-1, 3) * 0.02
    found, _ = shot(grid, 0.11, np.tile([0.0, 1, 0], (len(grid), 1)))
    inside = (np.abs(grid[:, [0, 2]] - grid[:, [0, 2]].mean(axis=0)) < 0.15).all(axis=1)
    cosines = np.abs(found).reshape(len(grid), -1, 11).sum(axis=1)
    alike = np.sort(cosines[inside], axis=1)
    np.testing.assert_allclose(alike, np.broadcast_to(alike[0], alike.shape), rtol=0.005, atol=1e-6)
    assert (np.count_nonzero(cosines[inside] > 1e-9, axis=1) == 1).all()  # all normals along z, or all against it


def test_points_without_neighbours_are_not_observed() -> None:
    ball = bumpy(100)
    lonely = np.concatenate([ball.points, [[5.0, 5, 5]]])
    cloud = shape(lonely, np.empty((0, 3), int), np.full(101, -1), np.zeros((101, 3)))
    result = describe(cloud, placed(DescribeParams, descriptor="shot", radius=0.3))
    assert result.observed[:100].mean() > 0.9
    assert not result.observed[100]
    assert (result.features[100] == 0).all()
    assert (result.counts == result.observed).all()


# --- what cannot be described


def test_few_points() -> None:
    def cloud(count: int) -> NormalizedShape:
        points = np.random.default_rng(0).random((count, 3))
        return shape(points, np.empty((0, 3), int), np.full(count, -1), np.zeros((count, 3)))

    with pytest.raises(ValueError, match="at least 8 different points"):
        describe(cloud(5), DescribeParams())
    for descriptor in ("hks", "wks", "shot"):
        found = features(cloud(12), descriptor=descriptor)
        assert np.isfinite(found).all()


def test_coincident_points_are_described_alike() -> None:
    ball = bumpy(200)
    again = np.append(np.arange(200), 7)
    twice = shape(ball.vertices, ball.faces, ball.point_faces[again], ball.point_barycentrics[again])
    for surface in ("mesh", "cloud"):
        for descriptor in ("hks", "shot"):
            found = features(twice, descriptor=descriptor, surface=surface, radius=0.3)
            np.testing.assert_allclose(found[7], found[200], atol=1e-6)
