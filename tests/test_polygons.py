"""Polygons of any outline are covered exactly, in every format that has them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.schemas.shape import Source
from b23d.stages.geometry.polygons import fans, triangulate
from b23d.stages.normalize import NormalizeParams, normalize
from tests.reading import area, surface

U = np.array([[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]], np.float64)
"""A square of 3 × 3 with a notch of 1 × 2: area 7."""


def text_of(points: np.ndarray) -> list[str]:
    return [" ".join(f"{x:.17g}" for x in point) for point in points]


def obj(points: np.ndarray, polygon: list[int]) -> bytes:
    return "\n".join([*(f"v {row}" for row in text_of(points)), "f " + " ".join(str(i + 1) for i in polygon)]).encode()


def off(points: np.ndarray, polygon: list[int]) -> bytes:
    face = f"{len(polygon)} {' '.join(map(str, polygon))}"
    return "\n".join([f"OFF\n{len(points)} 1 0", *text_of(points), face]).encode()


def ply(points: np.ndarray, polygon: list[int], encoding: str = "ascii") -> bytes:
    head = f"ply\nformat {encoding} 1.0\nelement vertex {len(points)}\nproperty double x\nproperty double y\n"
    head += "property double z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n"
    faces = [polygon, polygon[:2] + polygon[:1]]  # and one without area, so that lengths differ
    if encoding == "ascii":
        return (head + "\n".join([*text_of(points), *(f"{len(f)} {' '.join(map(str, f))}" for f in faces)])).encode()
    body = b"".join(bytes([len(face)]) + np.array(face, "<i4").tobytes() for face in faces)
    return head.encode() + points.astype("<f8").tobytes() + body


WRITERS: dict[str, Callable[[np.ndarray, list[int]], bytes]] = {
    "m.obj": obj,
    "m.off": off,
    "m.ply": ply,
    "binary.ply": lambda points, polygon: ply(points, polygon, "binary_little_endian"),
}


def lifted(flat: np.ndarray, tilt: np.ndarray) -> np.ndarray:
    """Points of the plane (n, 2) in a tilted plane of space."""
    axes = np.linalg.qr(tilt)[0]
    return flat @ axes[:, :2].T + [1, -2, 3]


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("first", range(8))
@pytest.mark.parametrize("backwards", [False, True])
def test_a_u_keeps_its_area_whichever_corner_comes_first(name: str, first: int, backwards: bool) -> None:
    order = np.roll(np.arange(8), first)[:: -1 if backwards else 1].tolist()
    points = lifted(U, np.array([[1.0, 2, 0], [0, 1, 1], [2, 0, 1]]))
    read = surface(WRITERS[name](points, order), name)
    assert area(read) == pytest.approx(7)
    assert set(read.problems) <= {"concave_polygons"}


def test_it_is_counted_where_users_look() -> None:
    shape = normalize(Source(shape="s", files={"m.obj": obj(lifted(U, np.eye(3)), list(range(8)))}, mesh="m.obj"),
                      NormalizeParams(count=8))  # fmt: skip
    assert shape.repairs["concave_polygons"] == 1


@st.composite
def stars(draw: st.DrawFn) -> np.ndarray:
    """Outlines seen whole from their middle, with notches as deep as may be."""
    radii = np.array(draw(st.lists(st.floats(0.05, 1), min_size=4, max_size=30)))
    return np.stack([f(np.arange(len(radii)) * 2 * np.pi / len(radii)) * radii for f in (np.cos, np.sin)], axis=1)


def shoelace(points: np.ndarray) -> float:
    after = np.roll(points, -1, axis=0)
    return float((points[:, 0] * after[:, 1] - points[:, 1] * after[:, 0]).sum() / 2)


@settings(max_examples=200, deadline=None)
@given(stars(), st.integers(0, 29), st.sampled_from(sorted(WRITERS)), st.integers(0, 1000))
def test_every_outline_keeps_its_area_and_side(flat: np.ndarray, first: int, name: str, seed: int) -> None:
    points = lifted(flat, np.random.default_rng(seed).normal(size=(3, 3)))
    read = surface(WRITERS[name](points, np.roll(np.arange(len(points)), first).tolist()), name)
    a, b, c = (read.vertices[read.faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a) / 2
    outline = sum(np.cross(points[i - 1], points[i]) for i in range(len(points))) / 2
    np.testing.assert_allclose(normals.sum(axis=0), outline, atol=1e-7)  # Stokes: holds for every right triangulation
    assert np.linalg.norm(normals, axis=1).sum() == pytest.approx(shoelace(flat), rel=1e-6)  # and nothing twice


def test_convex_polygons_stay_fans_from_their_first_corner() -> None:
    """So that shapes without a notch keep the triangles, and the random samples, that they had."""
    angles = np.linspace(0, 2 * np.pi, 7, endpoint=False)
    points = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    cut = triangulate(points, np.arange(7), np.array([7]))
    np.testing.assert_array_equal(cut.corners, fans(np.array([7]))[0])
    assert cut.concave == 0


def test_corners_that_repeat_or_lie_on_a_line() -> None:
    flat = U[[0, 0, 1, 2, 2, 3, 4, 5, 5, 6, 7]]
    flat = np.insert(flat, 2, [[1.5, 0]], axis=0)
    assert area(surface(obj(lifted(flat, np.eye(3)), list(range(len(flat)))), "m.obj")) == pytest.approx(7)


def test_a_hole_joined_by_a_bridge() -> None:
    outside, inside = [[0, 0], [3, 0], [3, 3], [0, 3]], [[1, 1], [1, 2], [2, 2], [2, 1]]
    flat = np.array([*outside, outside[0], inside[0], *inside[1:], inside[0]], np.float64)
    assert area(surface(obj(lifted(flat, np.eye(3)), list(range(len(flat)))), "m.obj")) == pytest.approx(8)


def test_polygons_that_are_not_flat_are_cut_along_their_mean_normal() -> None:
    bent = np.column_stack([U, np.array([0, 0.1, 0, -0.1, 0, 0.1, 0, -0.1])])
    read = surface(obj(bent, list(range(8))), "m.obj")
    flat = read.vertices * [1, 1, 0]
    a, b, c = (flat[read.faces[:, i]] for i in range(3))
    assert (np.cross(b - a, c - a)[:, 2] / 2).sum() == pytest.approx(7)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()


def test_texture_coordinates_follow_the_corners() -> None:
    points = lifted(U, np.eye(3))
    lines = [*(f"v {row}" for row in text_of(points)), *(f"vt {u:.9g} {v:.9g}" for u, v in U[::-1])]
    lines += ["f " + " ".join(f"{i + 1}/{8 - i}" for i in range(8))]
    read = surface("\n".join(lines).encode(), "m.obj")
    assert read.face_uvs is not None
    np.testing.assert_allclose(read.face_uvs, U[read.faces])


def test_outlines_too_long_to_cut_in_seconds_are_refused() -> None:
    count = 60_000
    jagged = np.random.default_rng(0).random((count, 3))
    with pytest.raises(ValueError, match=r"class/shape: m.obj: faces: .* got one of 60000"):
        surface(obj(jagged, list(range(count))), "m.obj")


def test_beside_goods_not_finite_corners_stay_fans() -> None:
    points = np.column_stack([U, np.zeros(8)])
    points[5] = np.nan
    assert len(surface(obj(points, list(range(8))), "m.obj").faces) == 6
