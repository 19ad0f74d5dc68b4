"""normalize: the unit frame, cleaning with exact counts, candidates on the surface."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.distance import cdist

from b23d.schemas.shape import NormalizedShape, Source
from b23d.stages.geometry.cleaning import fill_gaps
from b23d.stages.geometry.sampling import farthest_points, surface_samples
from b23d.stages.normalize import NormalizeParams, normalize
from tests.made_shapes import BOX, ROUGH, obj, of_cloud, of_mesh, on_surface
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


# --- cleaning --------------------------------------------------------------------------------------------------------


def test_every_repair_is_counted() -> None:
    """A clean box, and then: a copied vertex with a double face through it, two stray vertices (one NaN), and bad
    faces."""
    v, f = BOX.vertices.tolist(), BOX.faces.tolist()
    clean = of_mesh(v, f)
    assert set(clean.repairs.values()) == {0}
    n = len(v)
    a, b, c = f[0]
    dirty_v = [*v, v[a], [90, 90, 90], [np.nan, 0, 0], (np.array(v[a]) + v[b]) / 2]
    dirty_f = [
        [a, a, b],  # degenerate: a corner repeated
        [a, n, b],  # degenerate: a copy of it repeated
        [a, n + 3, b],  # degenerate: collinear
        *f,
        [c, b, a],  # duplicate: the other way round
        [b, n, c],  # duplicate: through the copied vertex
        f[1],  # duplicate
        [a, n + 2, b],  # non-finite
    ]
    shape = of_mesh(dirty_v, dirty_f, max_nonfinite=0.1)
    assert shape.repairs == {
        "unreferenced_vertices": 3,  # the copy, the middle of an edge, the one far out
        "degenerate_faces": 3,
        "duplicate_faces": 3,
        "non_finite_vertices": 1,
        "non_finite_faces": 1,
    }
    np.testing.assert_array_equal(shape.faces, clean.faces)
    np.testing.assert_array_equal(shape.vertices[:n], clean.vertices)
    assert (shape.center, shape.scale) == (clean.center, clean.scale)
    np.testing.assert_array_equal(shape.points, clean.points)
    np.testing.assert_array_equal(shape.vertices[n + 2], [0, 0, 0])
    assert np.isfinite(shape.vertices).all()


def test_a_needle_that_reaches_far_out_does_not_stretch_the_box() -> None:
    far = np.vstack([BOX.vertices, [[1e6, 0, 0], [2e6, 0, 0], [3e6, 0, 0]]])
    shape = of_mesh(far, np.vstack([BOX.faces, [[8, 9, 10]]]))
    assert shape.scale == 4
    assert len(shape.faces) == 12


def test_unreferenced_vertices_stay_finite_however_far() -> None:
    far = np.vstack([BOX.vertices, [[1e300, 0, 0], [0, -1e200, 0]]])
    shape = of_mesh(far, BOX.faces)
    assert shape.scale == 4
    assert np.isfinite(shape.vertices).all()


def test_an_icosphere_turned_inside_out_twice_keeps_one_skin() -> None:
    double = np.vstack([ROUGH.faces, ROUGH.faces[:, ::-1]])
    shape = of_mesh(ROUGH.vertices, double)
    np.testing.assert_array_equal(shape.faces, ROUGH.faces)


def test_gaps_are_filled_by_the_nearest_in_order() -> None:
    nan = [np.nan] * 3
    points = np.array([nan, [1, 0, 0], nan, nan, [4, 0, 0], [5, 0, np.inf], nan])
    assert fill_gaps(points)[:, 0].tolist() == [1, 1, 1, 4, 4, 4, 4]
    shape = of_cloud([[0, 0, 0], [np.nan, 0, 0], [1, 0, 0], [0, 2, 0]], max_nonfinite=0.3)
    assert shape.repairs == {"non_finite_points": 1}
    np.testing.assert_array_equal(shape.points[1], shape.points[0])


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


# --- candidates ------------------------------------------------------------------------------------------------------


def test_candidates_lie_where_they_say() -> None:
    shape = of_mesh(ROUGH.vertices, ROUGH.faces, count=500)
    assert shape.candidates == "fps"
    assert shape.points.shape == (500, 3)
    assert len(np.unique(shape.points, axis=0)) == 500
    np.testing.assert_allclose(on_surface(shape), shape.points, atol=2e-7)
    assert (shape.point_barycentrics >= 0).all()


def test_same_seed_same_candidates_other_seed_others() -> None:
    one, same, other = (of_mesh(ROUGH.vertices, ROUGH.faces, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.points, same.points)
    np.testing.assert_array_equal(one.point_faces, same.point_faces)
    assert (one.points != other.points).any()


def test_samples_are_uniform_over_the_area() -> None:
    """Two squares, one of nine times the other's area; within each, the mean and the variance of a uniform law."""
    v = np.array([[0, 0, 0], [3, 0, 0], [3, 3, 0], [0, 3, 0], [9, 0, 0], [10, 0, 0], [10, 1, 0], [9, 1, 0]], np.float64)
    f = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    p = surface_samples(v, f, 20_000, np.random.default_rng(0)).points
    large = p[p[:, 0] < 5]
    assert len(large) == pytest.approx(18_000, abs=2)
    np.testing.assert_allclose(large.mean(axis=0), [1.5, 1.5, 0], atol=0.03)
    np.testing.assert_allclose(large.var(axis=0), [0.75, 0.75, 0], atol=0.03)


def test_farthest_points_spread_as_far_as_the_greedy_rule_promises() -> None:
    """No two chosen are nearer than any point is to its nearest chosen one (Gonzalez 1985), and no point is chosen
    twice."""
    points = np.random.default_rng(1).random((3000, 3)).astype(np.float32)
    chosen = farthest_points(points, 200)
    assert len(set(chosen)) == 200
    covering = cKDTree(points[chosen]).query(points)[0].max()
    gaps = cdist(points[chosen], points[chosen])[~np.eye(200, dtype=bool)]
    assert gaps.min() >= covering * (1 - 1e-5)
    np.testing.assert_array_equal(chosen, farthest_points(points, 200))


@pytest.mark.parametrize("count", [1, 2, 3, 50])
def test_few_points_to_choose_from(count: int) -> None:
    points = np.random.default_rng(0).random((count, 3))
    assert (
        farthest_points(points, 3).tolist() == list(range(count))
        if count <= 3
        else len(set(farthest_points(points, 3))) == 3
    )


def test_a_cloud_is_taken_whole_and_in_order_unless_it_is_large() -> None:
    points = np.random.default_rng(0).normal(size=(300, 3))
    whole = of_cloud(points)
    assert whole.candidates == "cloud"
    np.testing.assert_array_equal(whole.points, whole.vertices)
    np.testing.assert_allclose(whole.points * whole.scale + whole.center, points, atol=1e-6)
    assert (whole.point_faces == -1).all()
    assert whole.kind == "cloud"
    for params in ({"cloud_limit": 200}, {"candidates": "fps"}):
        fewer = of_cloud(points, **params)
        assert fewer.candidates == "fps"
        assert len(fewer.points) == 128
        assert len(fewer.vertices) == 300
        assert {tuple(p) for p in fewer.points} <= {tuple(p) for p in fewer.vertices}
    assert of_cloud(points, cloud_limit=200, candidates="cloud").candidates == "cloud"


def test_a_large_cloud_with_holes_has_no_more_candidates_than_without() -> None:
    points = np.random.default_rng(0).normal(size=(10_000, 3))
    counts = [len(of_cloud(points[:left], count=2048).points) for left in (10_000, 8000, 5000)]
    assert counts == [2048, 2048, 2048]


def test_a_mesh_file_with_points_only_is_a_cloud() -> None:
    source = Source(shape="s", files={"m.obj": obj(ROUGH.vertices, [])}, mesh="m.obj")
    shape = normalize(source, NormalizeParams())
    assert (shape.kind, shape.candidates, len(shape.points)) == ("cloud", "cloud", len(ROUGH.vertices))


def test_a_cloud_on_its_mesh_knows_its_faces() -> None:
    """Points made on known faces are found there again, and lie on them."""
    made = surface_samples(ROUGH.vertices, ROUGH.faces, 400, np.random.default_rng(0))
    shape = of_mesh(ROUGH.vertices, ROUGH.faces, made.points)
    assert shape.candidates == "cloud"
    np.testing.assert_allclose(on_surface(shape), shape.points, atol=1e-6)
    inside = made.barycentrics.min(axis=1) > 1e-3
    np.testing.assert_array_equal(shape.point_faces[inside], made.faces[inside])


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


def test_the_sample_chair_has_double_faces_and_strays() -> None:
    name = "03001627/88382b877be91b2a572f8e1c1caad99e"
    root = shared("keypointnet")
    files = {
        "m.ply": (root / f"ShapeNetCore.v2.ply/{name}.ply").read_bytes(),
        "c.pcd": (root / f"pcds/{name}.pcd").read_bytes(),
    }
    shape = normalize(Source(shape="chair", files=files, mesh="m.ply", cloud="c.pcd"), NormalizeParams())
    assert shape.repairs["unreferenced_vertices"] == 23
    assert shape.repairs["duplicate_faces"] == 1661
    assert shape.candidates == "cloud"
    assert np.linalg.norm(on_surface(shape) - shape.points, axis=1).max() < 1e-5
