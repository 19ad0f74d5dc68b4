"""normalize: the unit frame, and what cannot be brought into one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.schemas.shape import NormalizedShape, Source
from b23d.stages.normalize import NormalizeParams, normalize
from tests.made_shapes import BOX, ROUGH, of_cloud, of_mesh, on_surface
from tests.shared_data import shared

# --- the unit frame --------------------------------------------------------------------------------------------------


@st.composite
def meshes(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    """A few triangles anywhere; always one with an area."""
    count = draw(st.integers(3, 10))
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    vertices = rng.uniform(-1, 1, (count, 3)) * 10.0 ** draw(st.integers(-6, 6)) + rng.uniform(-3, 3, 3)
    faces = np.vstack([[0, 1, 2], rng.integers(0, count, (draw(st.integers(0, 12)), 3))])
    return vertices, faces


@settings(max_examples=60, deadline=None)
@given(meshes())
def test_the_box_is_centred_its_longest_side_is_one_and_the_way_back_is_known(
    mesh: tuple[np.ndarray, np.ndarray],
) -> None:
    vertices, faces = mesh
    shape = of_mesh(vertices, faces)
    used = shape.vertices[np.unique(shape.faces)]
    low, high = used.min(axis=0), used.max(axis=0)
    np.testing.assert_allclose(low + high, 0, atol=3e-7)
    assert (high - low).max() == pytest.approx(1, abs=3e-7)
    source = shape.vertices.astype(float) * shape.scale + np.array(shape.center)
    np.testing.assert_allclose(source, vertices, atol=1e-6 * np.abs(vertices - shape.center).max())
    assert len(shape.vertices) == len(vertices)


@settings(max_examples=30, deadline=None)
@given(meshes(), st.randoms(use_true_random=False))
def test_the_order_and_the_winding_of_faces_do_not_move_the_frame(
    mesh: tuple[np.ndarray, np.ndarray], random: Any
) -> None:
    vertices, faces = mesh
    order = random.sample(range(len(faces)), len(faces))
    turned = np.array([random.sample(list(faces[i]), 3) for i in order])
    one, other = of_mesh(vertices, faces), of_mesh(vertices, turned)
    assert (one.center, one.scale) == (other.center, other.scale)
    np.testing.assert_array_equal(one.vertices, other.vertices)
    assert {tuple(sorted(f)) for f in one.faces.tolist()} == {tuple(sorted(f)) for f in other.faces.tolist()}
    assert one.repairs == other.repairs


@pytest.mark.parametrize("scale", [2.0**-20, 0.25, 2.0**30])
def test_scaling_by_a_power_of_two_changes_nothing_but_the_frame(scale: float) -> None:
    one, other = of_mesh(ROUGH.vertices, ROUGH.faces), of_mesh(ROUGH.vertices * scale, ROUGH.faces)
    np.testing.assert_array_equal(one.vertices, other.vertices)
    np.testing.assert_array_equal(one.points, other.points)
    assert other.scale == one.scale * scale


@settings(max_examples=30, deadline=None)
@given(st.floats(1e-3, 1e3), st.tuples(*[st.floats(-100, 100)] * 3))
def test_scale_and_place_in_the_file_do_not_matter(scale: float, offset: tuple[float, float, float]) -> None:
    one, other = of_cloud(ROUGH.vertices), of_cloud(ROUGH.vertices * scale + offset)
    np.testing.assert_allclose(one.points, other.points, atol=1e-6 + 1e-14 * max(map(abs, offset)) / scale)
    one, other = of_mesh(ROUGH.vertices, ROUGH.faces), of_mesh(ROUGH.vertices * scale + offset, ROUGH.faces)
    np.testing.assert_allclose(one.vertices, other.vertices, atol=1e-6 + 1e-14 * max(map(abs, offset)) / scale)


def test_the_mesh_gives_the_frame_of_its_cloud() -> None:
    inner = BOX.vertices[:4] * [1, 0.5, 0.5]
    cloud = np.vstack([inner * [1, 1, 1], BOX.vertices])
    shape = of_mesh(BOX.vertices, BOX.faces, cloud)
    assert shape.scale == 4
    np.testing.assert_allclose(shape.points, cloud / 4, atol=1e-7)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: of_mesh(np.vstack([BOX.vertices, [[np.nan] * 3]]), BOX.faces),
            r"expected finite vertices, got 1 of 9 NaN or infinite",
        ),
        (lambda: of_cloud([[np.nan, 0, 0]] * 3), "got 3 of 3"),
        (lambda: of_mesh([[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 1, 2], [0, 0, 1]]), "all degenerate"),
        (lambda: of_mesh([[0, 0, 0]] * 3, [[0, 0, 0]]), "all degenerate"),
        (lambda: of_mesh([[3, 3, 3]] * 3, [[0, 1, 2]]), "2 distinct points"),
        (lambda: of_cloud([[1, 2, 3]] * 5), "2 distinct points"),
        (lambda: of_cloud([[1, 2, 3]]), "2 distinct points"),
        (lambda: of_cloud([[1e308, 0, 0], [-1e308, 0, 0]]), "finite extent"),
        (
            lambda: of_mesh(BOX.vertices, BOX.faces, candidates="cloud"),
            'expected a point cloud for candidates = "cloud"',
        ),
        (lambda: of_mesh(BOX.vertices, BOX.faces, BOX.vertices * 3 + 5), "expected its cloud on its mesh"),
        (lambda: normalize(Source(shape="chair/one", files={}), NormalizeParams()), "got neither"),
        (
            lambda: normalize(Source(shape="chair/one", files={}, mesh="a.ply"), NormalizeParams()),
            "expected a.ply among its files",
        ),
    ],
)
def test_errors_name_the_shape_and_say_what_to_do(make: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words) as error:
        make()
    assert str(error.value).startswith("chair/one: ")
    assert "; " in str(error.value)


# --- real, messy shapes ----------------------------------------------------------------------------------------------


def check_real(shape: NormalizedShape) -> None:
    used = shape.vertices[np.unique(shape.faces)]
    assert np.abs(used).max() == pytest.approx(0.5, abs=1e-6)
    assert len(shape.points) == 2048
    np.testing.assert_allclose(on_surface(shape), shape.points, atol=1e-6)
    triangles = shape.vertices[shape.faces].astype(float)
    area = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    assert (area > 0).all()
    assert len(np.unique(np.sort(shape.faces, axis=1), axis=0)) == len(shape.faces)


@pytest.mark.parametrize("kind", [1, 3, 8, 12])
def test_real_meshes(kind: int) -> None:
    path = min(shared(f"capod/class{kind}").glob("*.obj"))
    check_real(normalize(Source(shape=path.stem, files={"m.obj": path.read_bytes()}, mesh="m.obj"), NormalizeParams()))


@pytest.mark.slow
def test_all_real_meshes() -> None:
    for path in sorted(shared("capod").rglob("*.obj")):
        check_real(
            normalize(Source(shape=path.stem, files={"m.obj": path.read_bytes()}, mesh="m.obj"), NormalizeParams())
        )
