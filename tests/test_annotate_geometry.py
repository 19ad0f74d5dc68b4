"""Where a click on a shape lands: exactly on the surface, on the near side, or where it was nearly meant."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from b23d.schemas.shape import Source
from b23d.stages.workbench.annotate.geometry import Pickable


def xyz(points: np.ndarray) -> bytes:
    return "\n".join(" ".join(map(repr, row)) for row in points.tolist()).encode()


def pickable(mesh: trimesh.Trimesh, cloud: np.ndarray | None = None, suffix: str = "ply") -> Pickable:
    files = {f"mesh.{suffix}": mesh.export(file_type=suffix)}
    if cloud is not None:
        files["cloud.xyz"] = xyz(cloud)
    files = {name: data.encode() if isinstance(data, str) else data for name, data in files.items()}
    return Pickable.load(
        Source(shape="box/one", files=files, mesh=f"mesh.{suffix}", cloud="cloud.xyz" if cloud is not None else None)
    )


def test_a_ray_lands_on_the_first_face_it_meets() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=7.0)
    mesh.apply_translation((100, -20, 3))
    shape = pickable(mesh)
    file_vertices = shape.vertices
    for direction in np.random.default_rng(0).normal(size=(30, 3)):
        direction /= np.linalg.norm(direction)
        hit = shape.hit((-3 * direction).tolist(), direction.tolist())
        assert hit is not None and hit.mesh_info is not None and hit.pcd_info is None
        corners = file_vertices[np.asarray(mesh.faces)[hit.mesh_info["face_index"]]]
        np.testing.assert_array_equal(np.asarray(hit.mesh_info["face_uv"]) @ corners, hit.xyz)
        assert sum(hit.mesh_info["face_uv"]) == pytest.approx(1) and min(hit.mesh_info["face_uv"]) >= 0
        assert np.linalg.norm(np.cross(hit.unit, direction)) < 1e-9, "on the ray"
        assert np.dot(hit.unit, direction) < 0 and np.dot(hit.normal, direction) < 0, (
            "on the near side, seen from the viewer"
        )
    assert shape.hit([0, 3, 0], [0, 1, 0]) is None and shape.hit([0.6, 3, 0], [0, -1, 0]) is None


def test_faces_are_counted_as_the_file_has_them() -> None:
    box = trimesh.creation.box(extents=(1, 1, 1))
    faces = np.insert(
        np.asarray(box.faces), [0, 0, 5], [[0, 0, 1], [2, 2, 2], [1, 1, 3]], axis=0
    )  # degenerate ones, which cleaning drops
    shape = pickable(trimesh.Trimesh(np.asarray(box.vertices), faces, process=False))
    hit = shape.hit([0.2, 3, 0.1], [0, -1, 0])
    assert hit is not None and hit.mesh_info is not None
    corners = np.asarray(box.vertices)[faces[hit.mesh_info["face_index"]]]
    np.testing.assert_allclose(np.asarray(hit.mesh_info["face_uv"]) @ corners, [0.2, 0.5, 0.1], atol=1e-7)


def test_a_cloud_gives_one_of_its_points_and_a_mesh_names_the_nearest() -> None:
    box = trimesh.creation.box(extents=(2, 1, 1))
    points = np.asarray(trimesh.sample.sample_surface(box, 3000, seed=0)[0])
    beside = pickable(box, points).hit([0.1, 3, 0.1], [0, -1, 0])
    assert beside is not None and beside.pcd_info is not None
    assert beside.pcd_info["point_index"] == np.linalg.norm(points - beside.xyz, axis=1).argmin()
    alone = Pickable.load(Source(shape="c/a", files={"cloud.xyz": xyz(points)}, cloud="cloud.xyz"))
    hit = alone.hit([0.1, 3, 0.1], [0, -1, 0])
    assert hit is not None and hit.pcd_info is not None and hit.mesh_info is None
    np.testing.assert_array_equal(points[hit.pcd_info["point_index"]], hit.xyz)
    assert hit.xyz[1] == pytest.approx(0.5), "the near side, not what shows between its points"
    assert alone.hit([0, 3, 2], [0, -1, 0]) is None


def test_colours_of_vertices_are_drawn() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2)
    mesh.visual.vertex_colors = np.where(mesh.vertices[:, :1] > 0, [[255, 0, 0, 255]], [[0, 0, 255, 255]])
    vertices, faces, colors = pickable(mesh).drawing()
    assert colors is not None and colors.shape == vertices.shape and len(faces)
    assert (colors[vertices[:, 0] > 0.2] == [255, 0, 0]).all() and (colors[vertices[:, 0] < -0.2] == [0, 0, 255]).all()


def slope(origin: np.ndarray, direction: np.ndarray, place: np.ndarray) -> float:
    """How far beside a ray a place lies, for each unit that it is away."""
    along = direction / np.linalg.norm(direction)
    far = (place - origin) @ along
    return float(np.linalg.norm(place - origin - far * along) / far)


def test_a_near_miss_lands_on_the_surface_that_looks_nearest() -> None:
    mesh = trimesh.creation.icosphere(subdivisions=2, radius=3.0)
    mesh.apply_translation((5, 6, 7))
    shape = pickable(mesh)
    sampled = shape.unit(np.asarray(trimesh.sample.sample_surface(mesh, 20_000, seed=0)[0]))
    origin = np.array([0.1, 0.2, 3.0])
    for angle in np.linspace(0, 2 * np.pi, 12, endpoint=False):
        direction = np.array([0.52 * np.cos(angle), 0.52 * np.sin(angle), 0]) - origin
        assert shape.hit(origin.tolist(), direction.tolist()) is None
        hit = shape.hit(origin.tolist(), direction.tolist(), within=0.05)
        assert hit is not None and hit.mesh_info is not None
        corners = shape.vertices[np.asarray(mesh.faces)[hit.mesh_info["face_index"]]]
        np.testing.assert_array_equal(np.asarray(hit.mesh_info["face_uv"]) @ corners, hit.xyz)
        found = slope(origin, direction, np.asarray(hit.unit))
        assert 0 < found <= min(slope(origin, direction, place) for place in sampled[:2000]) + 1e-9
        assert shape.hit(origin.tolist(), direction.tolist(), within=found * 0.99) is None
        again = shape.hit(origin.tolist(), direction.tolist(), within=found * 1.01)
        assert again is not None and again.xyz == hit.xyz


def test_what_hits_is_not_moved_by_snapping() -> None:
    shape = pickable(trimesh.creation.box(extents=(1, 0.8, 0.6)))
    ray = [0.2, 3.0, 0.1], [0.0, -1.0, 0.0]
    assert shape.hit(*ray) == shape.hit(*ray, within=0.1)


def test_an_extremity_is_the_tip_beside_the_click() -> None:
    box = trimesh.creation.box(extents=(1, 1, 1))
    for suffix_cloud in (False, True):
        vertices = np.asarray(box.vertices)
        if suffix_cloud:
            points = np.vstack([vertices, trimesh.sample.sample_surface(box, 4000, seed=0)[0]])
            shape = Pickable.load(Source(shape="c/a", files={"cloud.xyz": xyz(points)}, cloud="cloud.xyz"))
        else:
            shape = pickable(box)
        near = shape.hit([0.47, 3, 0.47], [0, -1, 0], extremity=True)
        assert near is not None
        np.testing.assert_allclose(near.unit, [0.5, 0.5, 0.5], atol=1e-3)
        if suffix_cloud:
            assert near.pcd_info == {"point_index": int(np.abs(points - 0.5).sum(axis=1).argmin())}
        else:
            assert near.mesh_info is not None and sorted(near.mesh_info["face_uv"]) == [0, 0, 1]
            corners = vertices[np.asarray(box.faces)[near.mesh_info["face_index"]]]
            np.testing.assert_array_equal(np.asarray(near.mesh_info["face_uv"]) @ corners, near.xyz)
            assert shape.hit([0.1, 3, 0.1], [0, -1, 0], extremity=True) == shape.hit([0.1, 3, 0.1], [0, -1, 0])
