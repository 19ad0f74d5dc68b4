"""Damaged shapes: no damage is the clean shape, each damage does what it says by as much as it says, and keypoints are
where their surface is."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree

from b23d.pipeline.address import leaf_address
from b23d.pipeline.dataset import Shape
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.shape import NormalizedShape, turned
from b23d.stages.datasets.damage import ScanDamage, clean_scan, damaged_scan, gone
from b23d.stages.datasets.damages.scan import Scan
from b23d.stages.datasets.procedural import Procedural
from b23d.stages.normalize import NormalizeParams, normalize
from tests.made_datasets import read

SHAPES = ("chair", "mug")


def listed(**damage: Any) -> list[Shape]:
    up = damage.pop("up", "y")
    return Procedural(kind="procedural", classes=list(SHAPES), count=2, up=up, damage=ScanDamage(**damage)).listed()


def keypoints(shape: Shape) -> Keypoints:
    found: Keypoints = read(shape.leaves["keypoints"])
    return found


def normalized(shape: Shape) -> NormalizedShape:
    return normalize(read(shape.leaves["source"]), NormalizeParams(count=128))


def address(shape: Shape, leaf: str) -> str:
    return leaf_address(shape.leaves[leaf].values, {})


def clean(index: int = 0, points: int = 0) -> Scan:
    return clean_scan(read(listed()[index].leaves["source"]), {"points": points})


def hurt(scan: Scan, kind: str, amount: float, seed: int = 0) -> Scan:
    return damaged_scan(scan, {"kind": kind, "amount": amount, "seed": seed})


def area(scan: Scan) -> float:
    from b23d.stages.geometry.cleaning import areas

    return float(areas(scan.vertices, scan.faces).sum())


def test_no_damage_is_the_data_set_itself() -> None:
    plain = Procedural(kind="procedural", classes=list(SHAPES), count=2)
    assert [vars(shape) for shape in listed()] == [vars(shape) for shape in plain.shapes()]


@pytest.mark.parametrize("kind", ["noise", "holes", "outliers", "flying", "soup", "turned"])
@pytest.mark.parametrize("points", [0, 500])
def test_nothing_happens_at_zero(kind: str, points: int) -> None:
    scan = clean(points=points)
    if kind == "soup" and points:
        with pytest.raises(ValueError, match="expected a mesh to tear, got a cloud"):
            hurt(scan, kind, 0.0)
        return
    left = hurt(scan, kind, 0.0)
    assert set(map(tuple, scan.vertices)) <= set(map(tuple, left.vertices)), "holes' faces are finer, no place is lost"
    assert area(left) == pytest.approx(area(scan)) or points


@pytest.mark.parametrize("kind", ["noise", "holes", "outliers", "flying", "uneven", "decimated", "shuffled", "soup"])
def test_a_seed_is_a_damage(kind: str) -> None:
    scan, amount = clean(), {"decimated": 100.0, "uneven": 8.0}.get(kind, 0.3)
    one, same, other = (hurt(scan, kind, amount, seed) for seed in (0, 0, 1))
    assert np.array_equal(one.vertices, same.vertices) and np.array_equal(one.faces, same.faces)
    by_chance = kind not in ("uneven", "decimated")  # of a mesh
    assert by_chance == (one.vertices.shape != other.vertices.shape or not np.array_equal(one.vertices, other.vertices))


@pytest.mark.parametrize("amount", [0.1, 0.4])
@pytest.mark.parametrize("points", [0, 2000])
def test_holes_take_the_share_that_is_asked_for(amount: float, points: int) -> None:
    scan = clean(points=points)
    left = hurt(scan, "holes", amount)
    share = len(left.vertices) / len(scan.vertices) if points else area(left) / area(scan)
    assert share == pytest.approx(1 - amount, abs=0.01)


@pytest.mark.parametrize("points", [0, 2000])
def test_one_side_is_what_faces_the_camera(points: int) -> None:
    ball = sphere()
    scan = ball if not points else Scan(clean_points(ball, points), np.zeros((0, 3), np.int64))
    left = hurt(scan, "one-sided", 90.0)
    assert left.places()[:, 0].min() > -0.35, "next to nothing of the far side (-x)"
    assert left.places()[:, 0].max() > 0.98 and len(left.places()) > 0.2 * len(scan.places())


def sphere() -> Scan:
    import trimesh

    ball = trimesh.creation.icosphere(4)
    return Scan(np.asarray(ball.vertices), np.asarray(ball.faces))


def clean_points(scan: Scan, count: int) -> np.ndarray:
    from b23d.stages.geometry.sampling import surface_samples

    return surface_samples(scan.vertices, scan.faces, count, np.random.default_rng(0)).points.astype(np.float64)


@pytest.mark.parametrize("index", range(4))
def test_decimation_keeps_to_its_number_and_near_the_shape(index: int) -> None:
    scan = clean(index)
    left = hurt(scan, "decimated", 500)
    assert 250 < len(left.faces) <= 500
    assert cKDTree(scan.vertices).query(left.vertices)[0].max() < 0.1 * scan.size
    assert len(hurt(clean(index, points=3000), "decimated", 500).vertices) == 500


def test_decimation_takes_no_part_away() -> None:
    for shape in Procedural(kind="procedural", classes=["chair", "table"], count=6).listed():
        scan = clean_scan(read(shape.leaves["source"]), {"points": 0})
        left = hurt(scan, "decimated", 500)
        assert area(left) == pytest.approx(area(scan), rel=0.06) and len(left.faces) < 550
        assert not gone(keypoints(shape).positions, scan, left).any()


def test_noise_is_as_large_as_it_says_along_the_normals() -> None:
    ball = sphere()
    moved = hurt(ball, "noise", 0.01).vertices
    radius = np.linalg.norm(moved, axis=1)
    assert radius.std() == pytest.approx(0.01 * ball.size, rel=0.05)
    assert np.allclose(moved / radius[:, None], ball.vertices, atol=0.02), "places of a sphere move in and out"


def test_a_mesh_under_noise_does_not_tear() -> None:
    torn = hurt(hurt(clean(), "soup", 1.0), "noise", 0.02)
    whole = hurt(clean(), "soup", 1.0)
    places = [len(np.unique(scan.vertices, axis=0)) for scan in (torn, whole)]
    assert places[0] == places[1]


@pytest.mark.parametrize("points", [0, 4000])
def test_strays_add_as_many_as_they_say(points: int) -> None:
    scan = clean(points=points)
    for kind, reach in (("outliers", 1.5), ("flying", 0.2)):
        left = hurt(scan, kind, 0.01)
        assert len(left.places()) == len(scan.places()) + round(0.01 * len(scan.places()))
        away = cKDTree(scan.vertices).query(left.vertices)[0] / scan.size
        assert 0.02 < away.max() < reach * np.sqrt(3)


@pytest.mark.parametrize("kind", ["soup", "shuffled"])
def test_soups_are_the_same_surface(kind: str) -> None:
    scan = clean()
    left = hurt(scan, kind, 0.5)
    corners = [{tuple(sorted(map(tuple, face))) for face in part.vertices[part.faces]} for part in (scan, left)]
    assert corners[0] == corners[1]
    torn = hurt(scan, kind, 1.0)
    assert len(torn.vertices) == 3 * len(torn.faces)


def test_uneven_points_are_denser_at_the_front() -> None:
    ball = Scan(clean_points(sphere(), 20_000), np.zeros((0, 3), np.int64))
    z = hurt(ball, "uneven", 10).vertices[:, 2]
    share = (
        (z < -0.8).sum() / (ball.vertices[:, 2] < -0.8).sum() / ((z > 0.8).sum() / (ball.vertices[:, 2] > 0.8).sum())
    )
    assert share == pytest.approx(10**0.9, rel=0.2)


@pytest.mark.parametrize("kind", ["holes", "one-sided"])
def test_keypoints_are_absent_where_their_surface_is_gone_and_nowhere_else(kind: str) -> None:
    for before, after in zip(listed(), listed(kind=kind, amount=0.4), strict=True):
        scan = clean_scan(read(before.leaves["source"]), {"points": 0})
        left = damaged_scan(scan, {"kind": kind, "amount": 0.4, "seed": 0})
        all_of_them, found = keypoints(before), keypoints(after)
        distance = cKDTree(np.concatenate([left.vertices, left.places()])).query(all_of_them.positions)[0] / scan.size
        kept = np.isin(all_of_them.ids, found.ids)
        assert distance[kept].max() < 0.035 and (kept.all() or distance[~kept].min() > 0.015)
        assert np.array_equal(found.positions, all_of_them.positions[kept]) and (found.point_indices == -1).all()
        assert all(set(orbit) <= set(found.ids.tolist()) for orbit in [*found.reflections, *found.rotations])


@pytest.mark.parametrize("up", ["y", "z", "-x"])
def test_a_pose_moves_keypoints_and_parts_with_the_shape(up: str) -> None:
    (before, *_), (after, *_) = listed(up=up), listed(up=up, kind="turned", amount=40)
    one, two = normalized(before), normalized(after)
    first, second = keypoints(before), keypoints(after)
    rotation = turned(40.0)  # about +y, where that is up
    upright = one.to_unit(first.positions) * one.scale + np.asarray(one.center)
    turned_there = two.to_unit(second.positions) * two.scale + np.asarray(two.center)
    assert np.allclose(upright @ rotation.T, turned_there, atol=1e-6)
    parts = [read(shape.leaves["parts"]).points for shape in (before, after)]
    there = two.to_unit(parts[1]) * two.scale + np.asarray(two.center)
    assert np.allclose((one.to_unit(parts[0]) * one.scale + np.asarray(one.center)) @ rotation.T, there, atol=1e-6)


def test_a_larger_shape_is_the_same_in_the_unit_frame() -> None:
    (before, *_), (after, *_) = listed(), listed(kind="scaled", amount=3)
    one, two = normalized(before), normalized(after)
    assert two.scale == pytest.approx(3 * one.scale) and np.allclose(one.vertices, two.vertices, atol=1e-6)
    assert np.allclose(one.to_unit(keypoints(before).positions), two.to_unit(keypoints(after).positions), atol=1e-6)


def test_the_first_of_each_class_stay_clean_as_the_train_split() -> None:
    plain = {shape.name: shape for shape in listed()}
    shapes = listed(kind="holes", amount=0.2, clean=1)
    assert [shape.official for shape in shapes] == ["train", "test"] * 2
    for shape in shapes:
        same = address(shape, "source") == address(plain[shape.name], "source")
        assert same == (shape.official == "train")
    sampled = listed(points=300, clean=1)
    assert all(read(shape.leaves["source"]).cloud == "cloud.ply" for shape in sampled), "of clean ones, too"


def test_damages_have_addresses_of_their_own() -> None:
    kinds: list[dict[str, Any]] = [
        {}, {"kind": "holes", "amount": 0.1}, {"kind": "holes", "amount": 0.2},
        {"kind": "holes", "amount": 0.1, "seed": 1}, {"kind": "noise", "amount": 0.1}, {"points": 50},
    ]  # fmt: skip
    for leaf in ("source", "keypoints"):
        assert len({address(listed(**kind)[0], leaf) for kind in kinds}) == len(kinds)
    assert address(listed(kind="holes", amount=0.1)[0], "source") == address(
        listed(kind="holes", amount=0.1, clean=0)[0], "source"
    )


@pytest.mark.parametrize(
    ("kind", "amount", "wanted"),
    [
        ("holes", 1, "below 1"), ("noise", 2, "from 0 to 1"), ("outliers", 10, "from 0 to 1"),
        ("flying", 1.5, "from 0 to 1"), ("soup", 2, "from 0 to 1"), ("shuffled", 50, "from 0 to 1"),
        ("decimated", 3, "of 4 or more"), ("uneven", 0.5, "of 1 or more"), ("scaled", 0, "of 1e-06 or more"),
    ],
)  # fmt: skip
def test_an_amount_that_cannot_be_is_refused_at_once(kind: Any, amount: float, wanted: str) -> None:
    with pytest.raises(ValueError, match=f"expected one {wanted} for '{kind}', got {amount:g}; set dataset.damage"):
        ScanDamage(kind=kind, amount=amount)


def test_what_cannot_be_damaged_so_is_told_by_its_name() -> None:
    for damage, told in (
        ({"kind": "soup", "amount": 0.5, "points": 50}, "expected a mesh to tear, got a cloud"),
        ({"kind": "uneven", "amount": 1e12}, "expected at most 5,000,000 faces"),
    ):
        shape = listed(**damage)[0]
        with pytest.raises(ValueError, match=f"{shape.name}: {damage['kind']}: {told}"):
            read(shape.leaves["source"])


@pytest.mark.parametrize(
    "points", [np.eye(3)[:1] * np.linspace(0, 1, 20)[:, None], np.repeat(np.eye(3)[:2], 9, axis=0)]
)
def test_one_side_of_what_has_none_is_an_error(points: np.ndarray) -> None:
    with pytest.raises(ValueError, match="expected points that the camera does not see edge-on"):
        hurt(Scan(points, np.zeros((0, 3), np.int64)), "one-sided", 45.0)
