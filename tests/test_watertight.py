"""Watertight meshes: closed whatever comes in, near it, and in the shape's own frame."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.schemas.keypoints import Keypoints
from b23d.stages.describe import DescribeParams, describe
from b23d.stages.geometry.keypoints import keypoint_candidates
from b23d.stages.geometry.nearest import nearest_on_faces
from b23d.stages.geometry.watertight import LEAK, one_closed_surface, uneven_edges, watertight
from tests.made_shapes import of_cloud, of_mesh, on_surface
from tests.shared_data import shared

BALL = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
BOWL = BALL.faces[BALL.vertices[BALL.faces].mean(axis=1)[:, 1] < 0]
CROSS = trimesh.util.concatenate([trimesh.creation.box((1, 0.3, 0.3)), trimesh.creation.box((0.3, 1, 0.3))])
FIN = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.5, 0, 0.4], [0.5, 1, 0.4]]) - [0.5, 0.5, 0]
FINNED = np.array([[0, 1, 2], [0, 2, 3], [0, 2, 4], [2, 4, 5]])


def check_closed(vertices: np.ndarray, faces: np.ndarray) -> None:
    """Every directed edge once, and once the other way; around every vertex one fan of faces; no face without area."""
    directed = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    assert len(np.unique(directed, axis=0)) == len(directed)
    assert {tuple(edge) for edge in directed.tolist()} == {tuple(edge) for edge in directed[:, ::-1].tolist()}
    assert uneven_edges(faces) == 0
    assert (trimesh.Trimesh(vertices, faces, process=False).area_faces > 0).all()
    assert faces.dtype == np.int32 and vertices.dtype == np.float32 and np.isfinite(vertices).all()
    assert len(np.unique(faces)) == len(vertices)


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        (BALL.vertices, BALL.faces),
        (BALL.vertices, BALL.faces[:, ::-1]),
        (BALL.vertices, BOWL),
        (CROSS.vertices, CROSS.faces),
        (FIN, FINNED),
        (FIN, FINNED[:1]),
    ],
    ids=["ball", "ball inside out", "bowl", "overlapping boxes", "fins", "one triangle"],
)
def test_closed_and_near_whatever_comes_in(vertices: np.ndarray, faces: np.ndarray) -> None:
    made, triangles = watertight(vertices, faces, 24)
    check_closed(made, triangles)
    assert trimesh.Trimesh(made, triangles, process=False).volume > 0  # normals point out
    assert nearest_on_faces(made, vertices, faces)[1].max() < 0.2 / 24
    rim = trimesh.Trimesh(vertices, faces, process=False).sample(500, seed=0)
    inner = faces is CROSS.faces  # what lies within the other box is gone, as it should be
    assert np.quantile(nearest_on_faces(rim, made, triangles)[1], 0.6 if inner else 1.0) < 0.8 / 24


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**32))
def test_any_soup_of_triangles_becomes_closed(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-0.5, 0.5, (3 * int(rng.integers(1, 9)), 3))
    check_closed(*watertight(corners, np.arange(len(corners)).reshape(-1, 3), 12))


def test_a_balls_volume() -> None:
    error = []
    for resolution in (12, 24, 48):
        vertices, faces = watertight(BALL.vertices, BALL.faces, resolution)
        error.append(trimesh.Trimesh(vertices, faces, process=False).volume / BALL.volume - 1)
    assert 0 < error[2] < error[1] < error[0] < 0.08 and error[2] < 0.02


def test_inner_shells_go_and_separate_parts_stay_apart() -> None:
    shells = trimesh.util.concatenate([BALL, trimesh.creation.icosphere(subdivisions=2, radius=0.3)])
    vertices, _ = watertight(shells.vertices, shells.faces, 24)
    assert np.linalg.norm(vertices, axis=1).min() > 0.48
    two = trimesh.util.concatenate(
        [trimesh.creation.box((0.2, 0.2, 0.2)).apply_translation([x, 0, 0]) for x in (-0.4, 0.4)]
    )
    assert trimesh.Trimesh(*watertight(two.vertices, two.faces, 24), process=False).body_count == 2


@pytest.mark.parametrize(("share", "closed"), [(0.5, True), (1.2, False)])
def test_narrow_holes_close_and_wide_ones_do_not(share: float, closed: bool) -> None:
    radius = share * 2 * LEAK / 24
    ring = trimesh.creation.annulus(r_min=radius, r_max=0.5, height=0.1)
    made = trimesh.Trimesh(*watertight(ring.vertices, ring.faces, 24), process=False)
    assert made.euler_number == (2 if closed else 0)


def test_the_same_twice() -> None:
    for one, other in zip(watertight(FIN, FINNED, 24), watertight(FIN, FINNED, 24), strict=True):
        assert np.array_equal(one, other)


# --- the option of normalize -----------------------------------------------------------------------------------------


def test_normalize_keeps_the_frame_and_says_what_it_did() -> None:
    plain = of_mesh(FIN * 7 + 3, FINNED)
    shape = of_mesh(FIN * 7 + 3, FINNED, watertight=True, watertight_resolution=24)
    check_closed(shape.vertices, shape.faces)
    assert (shape.center, shape.scale) == (plain.center, plain.scale)
    assert shape.repairs["uneven_edges"] == 8 and shape.repairs["watertight_faces"] == len(shape.faces)
    assert "watertight_faces" not in plain.repairs
    assert np.allclose(on_surface(shape), shape.points, atol=1e-6)
    assert np.abs(shape.vertices).max() < 0.5 + 0.2 / 24


def test_annotated_places_find_their_candidates() -> None:
    ids = np.array([0, 1], np.int32)
    places = np.array([[0, 3.5, 0], [3.5, 0, 0]])
    keypoints = Keypoints(ids=ids, positions=places, point_indices=np.array([-1, -1], np.int32))
    shape = of_mesh(BALL.vertices * 7, BALL.faces, watertight=True, watertight_resolution=24, count=512)
    found = shape.points[keypoint_candidates(keypoints, shape)] * shape.scale + shape.center
    assert np.linalg.norm(found - places, axis=1).max() < 0.05 * 7


def test_a_cloud_on_the_mesh_stays_and_is_tied_to_the_closed_one() -> None:
    cloud = trimesh.Trimesh(FIN, FINNED, process=False).sample(200, seed=0)
    plain = of_mesh(FIN, FINNED, cloud)
    shape = of_mesh(FIN, FINNED, cloud, watertight=True, watertight_resolution=24)
    assert shape.candidates == "cloud" and np.array_equal(shape.points, plain.points)
    assert np.linalg.norm(on_surface(shape) - shape.points, axis=1).max() < 0.8 / 24


def test_a_bare_cloud_stays_as_it_is() -> None:
    points = np.random.default_rng(0).normal(size=(50, 3))
    assert np.array_equal(of_cloud(points, watertight=True).points, of_cloud(points).points)


def test_one_closed_surface_stays_as_it_is() -> None:
    """So that asking for watertight meshes changes nothing, and encodes nothing again, where they are."""
    closed = of_mesh(BALL.vertices * 7, BALL.faces, watertight=True)
    plain = of_mesh(BALL.vertices * 7, BALL.faces)
    assert np.array_equal(closed.vertices, plain.vertices) and np.array_equal(closed.points, plain.points)
    assert closed.repairs == plain.repairs


@pytest.mark.parametrize(
    "faces", [BALL.faces[:, ::-1], BALL.faces[1:], BOWL], ids=["inside out", "a face missing", "half"]
)
def test_what_is_not_one_closed_surface_is_replaced(faces: np.ndarray) -> None:
    assert one_closed_surface(BALL.vertices, BALL.faces)
    assert not one_closed_surface(BALL.vertices, faces) and not one_closed_surface(CROSS.vertices, CROSS.faces)
    shape = of_mesh(BALL.vertices, faces, watertight=True, watertight_resolution=16)
    assert shape.repairs["watertight_faces"] == len(shape.faces)


def test_heat_crosses_parts_that_only_overlap() -> None:
    """Two boxes through each other: unconnected for the Laplacian, one surface when watertight."""
    shape = of_mesh(CROSS.vertices, CROSS.faces, watertight=True, watertight_resolution=24)
    features = describe(shape, DescribeParams(surface="mesh", hks={"eigenpairs": 16})).features.astype(float)
    from_middle = np.abs(shape.points).max(axis=1)
    assert (
        features[from_middle > 0.45, 0].mean() > 1.2 * features[from_middle < 0.2, 0].mean()
    )  # ends of arms hold heat


def test_a_real_mesh() -> None:
    mesh = trimesh.load(shared("capod/class11/m127.obj"), process=False, force="mesh")
    shape = of_mesh(mesh.vertices, mesh.faces, watertight=True, watertight_resolution=48)
    check_closed(shape.vertices, shape.faces)
    assert shape.repairs["uneven_edges"] > 0
