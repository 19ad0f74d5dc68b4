"""Keypoints too small by a unit, or with their axes mixed up, on shapes that stand on the origin, are not let pass and
not taken for another mistake: a collapsed annotation lies on any surface at the origin."""

from __future__ import annotations

from itertools import permutations, product
from typing import Any

import numpy as np
import pytest
import trimesh

from b23d.schemas.shape import NormalizedShape, Source
from b23d.stages.normalize import NormalizeParams, normalize
from tests.test_annotation import check, cloud

HEIGHT, BOTTOM, TOP, AROUND = 15.0, 3.4, 4.6, 16


def mug() -> trimesh.Trimesh:
    """A tapered mug with a handle, y up, its base on the origin."""
    angles = 2 * np.pi * np.arange(AROUND) / AROUND
    rings = [
        np.stack([radius * np.cos(angles), np.full(AROUND, y), radius * np.sin(angles)], 1)
        for radius, y in ((BOTTOM, 0), (TOP, HEIGHT), (TOP - 0.4, HEIGHT), (BOTTOM - 0.4, 0.5))
    ]
    faces: list[list[int]] = []
    for j in range(AROUND):
        following = (j + 1) % AROUND
        for ring in range(3):
            a, b = ring * AROUND + j, ring * AROUND + following
            faces += [[a, b, a + AROUND], [b, b + AROUND, a + AROUND]]
        faces += [[4 * AROUND, following, j], [4 * AROUND + 1, 3 * AROUND + j, 3 * AROUND + following]]
    body = trimesh.Trimesh(np.concatenate([*rings, [[0, 0, 0], [0, 0.5, 0]]]), faces, process=False)
    handle = trimesh.creation.torus(major_radius=3.5, minor_radius=0.5, major_sections=12, minor_sections=6)
    handle.apply_translation([4.6, 0.5 * HEIGHT, 0])
    joined: Any = trimesh.util.concatenate([body, handle])
    made: trimesh.Trimesh = joined
    return made


def keypoints() -> np.ndarray:
    """Base, rim on three sides, and the handle's outermost place."""
    vertices = np.asarray(mug().vertices)
    outermost = vertices[vertices[:, 0].argmax()]
    return np.array([[0, 0, 0], [TOP, HEIGHT, 0], [-TOP, HEIGHT, 0], [0, HEIGHT, TOP], outermost])


@pytest.fixture(scope="module")
def shape() -> NormalizedShape:
    return normalize(
        Source(shape="mug/a", files={"m.ply": mug().export(file_type="ply")}, mesh="m.ply"), NormalizeParams(count=512)
    )


@pytest.fixture(scope="module")
def scan() -> NormalizedShape:
    surface = np.asarray(trimesh.sample.sample_surface(mug(), 3000, seed=0)[0])
    return cloud(np.concatenate([surface, keypoints()]))


@pytest.mark.parametrize("unit", [1000, 100, 10, 1 / 0.0254, 25.4, 12, 304.8])
@pytest.mark.parametrize("kind", ["shape", "scan"])
def test_keypoints_too_small_by_a_unit_are_refused_and_it_is_named(
    unit: float, kind: str, request: pytest.FixtureRequest
) -> None:
    on = request.getfixturevalue(kind)
    assert check(keypoints(), on).warnings == []
    with pytest.raises(ValueError, match=rf"likely scaled ×{1 / unit:.4g} \("):
        check(keypoints() / unit, on)


@pytest.mark.parametrize("factor", [1e-9, 1e-5, 1 / 500, 1 / 77, 1 / 33, 1 / 20.5])
@pytest.mark.parametrize("count", [3, 5])
def test_keypoints_too_small_by_any_factor_are_told_at_least(factor: float, count: int, shape: NormalizedShape) -> None:
    try:
        (told,) = check(keypoints()[:count] * factor, shape).warnings
    except ValueError as error:
        told = str(error)
    assert f"expected keypoints apart from each other, got all {count} within" in told
    assert "lower stages.annotation.together" in told


def test_keypoints_at_one_place_are_refused(shape: NormalizedShape) -> None:
    with pytest.raises(ValueError, match=r"all 3 within 0 longest sides, keypoint 0 at \(0, 0, 0\); are they in"):
        check(np.zeros((3, 3)), shape)


def test_one_keypoint_and_two_near_together_are_no_mistake(shape: NormalizedShape) -> None:
    assert check(keypoints()[:1], shape).warnings == []
    pair = keypoints()[1] + np.array([[0, 0, 0], [0.0, 0.0, 0.05]])
    (told,) = check(pair, shape).warnings
    assert "got all 2 within" in told
    assert check(pair, shape, together=0.0).warnings == []


@pytest.mark.parametrize("apart", [0.07, 0.14])
def test_keypoints_near_together_that_lie_on_the_surface_pass(apart: float, shape: NormalizedShape) -> None:
    """On the base, the plane through the origin, where they still lie if they are scaled up."""
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 0, 1], [1, 0, 1], [0.5, 0, 0.5]])
    side = apart * shape.scale / np.ptp(corner, axis=0).max()
    assert check(corner * side, shape).warnings == []


def test_a_smaller_limit_lets_keypoints_lie_together(shape: NormalizedShape) -> None:
    near = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0, 0.1]])
    with pytest.raises(ValueError, match=r"lower stages\.annotation\.together"):
        check(near, shape)
    assert check(near, shape, together=0.001).warnings == []


TURNS = [(order, sign) for order in permutations(range(3)) for sign in product((1, -1), repeat=3)]


@pytest.mark.parametrize("unit", [1, 1000, 0.01])
def test_up_mixed_up_is_named_and_not_taken_for_a_unit(unit: float, shape: NormalizedShape) -> None:
    x, y, z = keypoints().T
    named = {"z up for y up: right as (x, z, -y)": (x, -z, y), "y up for z up: right as (x, -z, y)": (x, z, -y)}
    for words, mixed in named.items():
        with pytest.raises(ValueError, match="likely") as error:
            check(np.stack(mixed, 1) * unit, shape)
        assert words in str(error.value)
        assert ("scaled" in str(error.value)) == (unit != 1)


def test_no_order_or_direction_of_axes_is_taken_for_a_unit(shape: NormalizedShape) -> None:
    """All but the identity and the mug's own mirror image are refused as what they are."""
    places = np.concatenate([keypoints(), np.asarray(trimesh.sample.sample_surface(mug(), 3, seed=1)[0])])
    for order, sign in TURNS[1::7]:
        turned = places[:, list(order)] * np.array(sign)
        try:
            assert check(turned, shape).warnings == [] and order == (0, 1, 2) and sign[:2] == (1, 1)
        except ValueError as error:
            assert ("axes" in str(error) or "mirrored" in str(error)) and "scaled" not in str(error), (order, sign)


def test_the_limits_to_raise_let_it_pass(shape: NormalizedShape) -> None:
    """As many as it takes: what is explained exactly is refused from `warn` on, and `warn` is at most `refuse`."""
    x, y, z = keypoints().T
    swapped = np.stack([x, -z, y], 1)
    with pytest.raises(ValueError, match=r"raise stages\.annotation\.refuse and stages\.annotation\.warn$"):
        check(swapped, shape)
    with pytest.raises(ValueError, match=r"raise stages\.annotation\.warn$"):
        check(swapped, shape, refuse=3.0)
    check(swapped, shape, refuse=3.0, warn=3.0)
