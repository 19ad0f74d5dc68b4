"""The nearest face to a point beside brute force; annotated keypoints on a shape's candidates."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from b23d.schemas.keypoints import Keypoints
from b23d.stages.geometry.keypoints import check_keypoints, keypoint_candidates
from b23d.stages.geometry.nearest import cover, nearest_barycentrics, nearest_on_faces
from b23d.stages.geometry.sampling import surface_samples
from tests.made_shapes import of_cloud


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from(["any", "needle", "line", "point"]))
def test_nearest_place_on_a_triangle_is_nearest(seed: int, kind: str) -> None:
    """No place of a fine grid on the triangle is nearer, also where the triangle is hardly one."""
    rng = np.random.default_rng(seed)
    triangle = rng.normal(size=(3, 3))
    if kind == "needle":
        triangle[2] = triangle[0] * 0.3 + triangle[1] * 0.7 + 1e-9
    elif kind == "line":
        triangle[2] = 2 * triangle[1] - triangle[0]
    elif kind == "point":
        triangle[:] = triangle[0]
    points = rng.normal(size=(20, 3)) * 2
    b = nearest_barycentrics(points, np.repeat(triangle[None], 20, axis=0))
    np.testing.assert_allclose(b.sum(axis=1), 1, atol=1e-12)
    assert (b >= 0).all()
    i, j = np.meshgrid(np.arange(41), np.arange(41))
    grid = np.stack([i, j, 40 - i - j], axis=-1)[i + j <= 40] / 40
    found = np.linalg.norm(b @ triangle - points, axis=1)
    assert (found <= cdist(points, grid @ triangle).min(axis=1) + 1e-9).all()


def test_nearest_faces_beside_brute_force() -> None:
    """On a mesh with long needles beside small faces, points on it and around it."""
    mesh = trimesh.creation.cylinder(0.5, 1.0, sections=200)  # 200 needles as sides and in each lid
    rng = np.random.default_rng(0)
    on = surface_samples(mesh.vertices, mesh.faces, 300, rng).points
    points = np.vstack([on, on * rng.uniform(0.95, 1.05, (300, 1))])
    _, distance = nearest_on_faces(points, mesh.vertices, mesh.faces)
    triangles = mesh.vertices[mesh.faces]
    every = nearest_barycentrics(np.repeat(points, len(triangles), axis=0), np.tile(triangles, (len(points), 1, 1)))
    places = np.einsum("nc,ncx->nx", every, np.tile(triangles, (len(points), 1, 1)))
    exact = (
        np.linalg.norm(places - np.repeat(points, len(triangles), axis=0), axis=1).reshape(len(points), -1).min(axis=1)
    )
    np.testing.assert_allclose(distance, exact, atol=1e-12)
    away = points + np.array([0, 9, 0])
    far, distance = nearest_on_faces(away, mesh.vertices, mesh.faces)
    np.testing.assert_allclose(np.linalg.norm(away - far.points, axis=1), distance, atol=1e-6)
    assert (distance <= cKDTree(mesh.vertices).query(away)[0] + 0.02).all(), "far points get a near face"


def test_every_place_on_a_face_is_near_one_of_its_anchors() -> None:
    rng = np.random.default_rng(0)
    needles = rng.normal(size=(60, 3, 3)) * 0.3
    needles[::2, 2] = needles[::2, 0] * 0.4 + needles[::2, 1] * 0.6 + rng.normal(size=(30, 3)) * 1e-3
    vertices, faces = needles.reshape(-1, 3), np.arange(180).reshape(60, 3)
    anchors = cover(vertices, faces)
    for face in range(60):
        places = rng.dirichlet([0.3] * 3, 2000) @ needles[face]
        assert cKDTree(anchors.points[anchors.faces == face]).query(places)[0].max() <= anchors.radius + 1e-12


def annotated(positions: Any, indices: list[int]) -> Keypoints:
    return Keypoints(ids=np.arange(len(indices), dtype=np.int32) + 10,
                     positions=np.asarray(positions, np.float64).reshape(-1, 3),
                     point_indices=np.array(indices, np.int32))  # fmt: skip


def test_keypoints_are_found_among_candidates() -> None:
    points = np.random.default_rng(0).normal(size=(300, 3)) * 7 + 5
    chosen = [5, 299, 0]
    whole, fewer = of_cloud(points), of_cloud(points, candidates="fps")
    np.testing.assert_array_equal(
        keypoint_candidates(annotated(points[chosen] + 99, chosen), whole), chosen
    )  # the index counts
    np.testing.assert_array_equal(keypoint_candidates(annotated(points[chosen], [5, -1, -1]), whole), chosen)
    found = keypoint_candidates(annotated(points[chosen], chosen), fewer)
    unit = (points[chosen] - fewer.center) / fewer.scale
    np.testing.assert_array_equal(found, cdist(unit, fewer.points).argmin(axis=1))
    assert keypoint_candidates(annotated([], []), fewer).shape == (0,)


def test_a_keypoint_beyond_the_cloud_is_an_error() -> None:
    points = np.random.default_rng(0).normal(size=(30, 3))
    keypoints = annotated(points[:2], [3, 30])
    with pytest.raises(
        ValueError, match="keypoint 11 of chair/one: expected a point index below 30, got 30; mend the annotation file"
    ):
        check_keypoints(keypoints, of_cloud(points), "chair/one")
    check_keypoints(keypoints, of_cloud(points, candidates="fps", count=8))
