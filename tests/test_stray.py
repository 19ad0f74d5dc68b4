"""Stray points and specks: they do not move the frame, are told, and are nothing that belongs to a shape."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from b23d.stages.datasets.damage import ScanDamage
from b23d.stages.datasets.procedural import Procedural
from b23d.stages.geometry.stray import stray_faces, stray_points
from b23d.stages.normalize import NormalizeParams, normalize
from tests.made_datasets import read
from tests.made_shapes import of_cloud, of_mesh, on_surface

rng = np.random.default_rng(0)
SPECK = np.array([[0, 0, 0], [0.01, 0, 0], [0, 0.01, 0]])


def box_and_specks(*places: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    box = trimesh.creation.box((1.0, 0.6, 0.4)).subdivide().subdivide()
    vertices = [np.asarray(box.vertices), *(SPECK + np.array(place) for place in places)]
    faces = [np.asarray(box.faces)]
    faces += [len(box.vertices) + 3 * i + np.arange(3)[None] for i in range(len(places))]
    return np.concatenate(vertices), np.concatenate(faces)


def box_points(count: int) -> np.ndarray:
    return np.asarray(trimesh.sample.sample_surface(trimesh.creation.box((1.0, 0.6, 0.4)), count, seed=1)[0])


def test_a_mesh_is_in_the_frame_that_it_has_without_its_specks() -> None:
    clean = of_mesh(*box_and_specks())
    dirty = of_mesh(*box_and_specks((2.0, 0.0, 0.0), (0.0, 3.0, 0.0)))
    assert dirty.scale == clean.scale and dirty.center == clean.center
    assert np.array_equal(dirty.faces, clean.faces) and np.array_equal(dirty.points, clean.points)
    assert dirty.repairs["stray_faces"] == 2 and "stray_faces" not in clean.repairs
    assert len(dirty.vertices) == len(clean.vertices) + 6, "vertices stay the file's"
    assert np.allclose(on_surface(dirty), dirty.points, atol=1e-6)


def test_a_cloud_is_in_the_frame_that_it_has_without_its_stray_points() -> None:
    points = box_points(1000)
    clean = of_cloud(points)
    dirty = of_cloud(np.concatenate([points, [[3.0, 0, 0], [0, -4.0, 0], [0, 0, 1.0]]]))
    assert dirty.scale == clean.scale and dirty.repairs["stray_points"] == 3
    assert len(dirty.vertices) == 1003, "indices stay the file's"
    assert np.array_equal(dirty.vertices[:1000], clean.vertices)
    assert len(np.unique(dirty.vertices, axis=0)) == 1000 and len(np.unique(dirty.vertices[1000:], axis=0)) == 3


@pytest.mark.parametrize("keep", ["mesh", "cloud"])
def test_who_wants_them_keeps_them(keep: str) -> None:
    if keep == "mesh":
        kept = of_mesh(*box_and_specks((2.0, 0.0, 0.0)), stray="keep")
    else:
        kept = of_cloud(np.concatenate([box_points(1000), [[2.005, 0, 0]]]), stray="keep")
    assert kept.scale == pytest.approx(2.5, abs=0.01) and not any("stray" in key for key in kept.repairs)


def test_a_lone_speck_within_the_frame_goes_a_chain_of_them_stays() -> None:
    inside = of_mesh(*box_and_specks((0.45, 0.29, 0.5)))
    assert len(inside.faces) == len(box_and_specks()[1]) and inside.repairs["stray_faces"] == 1
    chain = of_mesh(*box_and_specks(*((0.0, 0.32 + 0.02 * i, 0.0) for i in range(10))))
    assert len(chain.faces) == len(box_and_specks()[1]) + 10


@pytest.mark.parametrize("part", [trimesh.creation.box((0.015, 0.015, 0.015)), trimesh.creation.icosphere(1, 0.008)])
def test_knobs_and_rivets_stay_though_they_touch_nothing(part: trimesh.Trimesh) -> None:
    places = [(-0.3, 0.0, 0.228), (0.3, 0.0, 0.228), (0.0, 0.2, 0.228)]
    knobs = [part.copy().apply_translation(place) for place in places]
    both = trimesh.util.concatenate([trimesh.creation.box((1.0, 0.6, 0.4)).subdivide(), *knobs])
    assert not stray_faces(both.vertices, both.faces).any()


def test_a_part_beside_the_shape_stays_where_the_frame_does_not_reach_for_it() -> None:
    plate = trimesh.creation.box((0.03, 0.01, 0.03)).apply_translation((0.3, 0.4, 0.0))
    both = trimesh.util.concatenate([trimesh.creation.box((1.0, 0.6, 0.4)).subdivide(), plate])
    assert not stray_faces(both.vertices, both.faces).any()


@pytest.mark.parametrize("spacing", [0.01, 0.03])
def test_points_fly_a_cable_does_not_however_few_its_points(spacing: float) -> None:
    along = np.arange(0.3 + spacing, 0.6, spacing)
    cable = np.stack([np.full(len(along), -0.3), along, np.zeros(len(along))], axis=1)
    points = np.concatenate([box_points(10_000), cable])
    assert not stray_points(points).any()
    air = rng.uniform((-0.2, 0.37, -0.2), (0.5, 0.6, 0.2), (50, 3))
    stray = stray_points(np.concatenate([points, air]))
    assert not stray[: len(points)].any() and stray[len(points) :].mean() > 0.8
    assert not stray_points(np.concatenate([points, air[:10]])).any(), (
        "so few may be a wire's, and the frame is as it is"
    )


@pytest.mark.parametrize("a_leg", [15, 25, 60])
def test_legs_that_a_scanner_saw_few_points_of_stay(a_leg: int) -> None:
    random = np.random.default_rng(a_leg)
    top = random.uniform((0, 0.98, 0), (1, 1, 1), (10_000, 3))
    legs = [
        np.array([x, 0, z]) + random.uniform((0, 0, 0), (0.03, 1, 0.03), (a_leg, 3)) for x in (0, 1) for z in (0, 1)
    ]
    assert not stray_points(np.concatenate([top, *legs])).any()


def test_a_scan_that_thins_out_stays_whole() -> None:
    random = np.random.default_rng(0)
    distance, angle = 1 / random.uniform(0.02, 1, 10_000), random.uniform(0, 2 * np.pi, 10_000)
    ground = np.stack([distance * np.cos(angle), 0 * angle, distance * np.sin(angle)], axis=1)
    assert not stray_points(ground / np.ptp(ground)).any()
    assert "stray_points" not in of_cloud(ground).repairs


def test_what_is_taken_for_stray_is_little_however_often_it_is_looked_for() -> None:
    """Each time the farthest are gone, the next are: a ball of points without a surface."""
    points = np.random.default_rng(0).standard_t(3, (10_000, 3))
    assert of_cloud(points).repairs.get("stray_points", 0) <= 500


def test_flying_points_are_no_candidates() -> None:
    for points in (0, 10_000):
        plain, dirty = (
            Procedural(kind="procedural", count=1, damage=ScanDamage(points=points, **damage)).listed()
            for damage in ({}, {"kind": "flying", "amount": 0.01})
        )
        for one, other in zip(plain, dirty, strict=True):
            clean, damaged = (normalize(read(s.leaves["source"]), NormalizeParams()) for s in (one, other))
            surface = clean.to_source(clean.vertices if points else clean.points)
            away = cKDTree(surface).query(damaged.to_source(damaged.points))[0] / clean.scale
            assert away.max() < 0.05 and (away > 0.04).mean() < 0.002
            assert damaged.scale == pytest.approx(clean.scale, rel=0.02)


def test_what_does_not_reach_out_stays() -> None:
    near = of_mesh(*box_and_specks((0.515, 0.0, 0.0)))
    assert len(near.faces) == len(box_and_specks()[1]) + 1


def test_a_part_of_some_size_stays_however_far() -> None:
    box = trimesh.creation.box((1.0, 0.6, 0.4))
    moon = trimesh.creation.box((0.1, 0.1, 0.1)).apply_translation((2.0, 0.0, 0.0))
    both = trimesh.util.concatenate([box, moon])
    assert not stray_faces(both.vertices / 3, both.faces).any()
    points = np.concatenate([box_points(1000), rng.uniform(0, 0.1, (20, 3)) + np.array([2.0, 0, 0])])
    assert not stray_points(points / 3).any()


def test_half_a_cloud_is_never_stray() -> None:
    assert not stray_points(rng.uniform(size=(300, 3))).any()
    assert not stray_points(rng.uniform(size=(5, 3))).any()
    shell = rng.normal(size=(200, 3))
    assert not stray_points(np.concatenate([shell / np.linalg.norm(shell, axis=1, keepdims=True), shell])).mean() > 0.05


@pytest.mark.parametrize("points", [0, 2048, 8000])
def test_outliers_change_no_frame_and_clean_shapes_have_none(points: int) -> None:
    plain = Procedural(kind="procedural", count=2, damage=ScanDamage(points=points)).listed()
    dirty = Procedural(
        kind="procedural", count=2, damage=ScanDamage(points=points, kind="outliers", amount=0.005)
    ).listed()
    for one, other in zip(plain, dirty, strict=True):
        clean, damaged = (normalize(read(s.leaves["source"]), NormalizeParams(count=64)) for s in (one, other))
        assert not any("stray" in key for key in clean.repairs)
        assert damaged.scale == pytest.approx(clean.scale, rel=0.03)
