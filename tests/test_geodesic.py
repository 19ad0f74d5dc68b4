"""geodesic: analytic distances (sphere, plane, line, plate), the metric's laws, components, degenerate sets."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from b23d.schemas.shape import NormalizedShape
from b23d.stages.geodesic import GeodesicParams, geodesic
from b23d.stages.geodesics.graph import neighbour_edges
from b23d.stages.geodesics.shortcuts import consistently_wound, cut_shortcuts
from tests.made_params import placed

HALF_PRECISION = 1e-3  # float16's relative step, twice


def shape(
    points: np.ndarray, vertices: np.ndarray | None = None, faces: np.ndarray | None = None, on: tuple | None = None
) -> NormalizedShape:
    on = on or (np.full(len(points), -1), np.zeros((len(points), 3)))
    return NormalizedShape(
        kind="cloud" if faces is None else "mesh",
        vertices=(points if vertices is None else vertices).astype(np.float32),
        faces=(np.empty((0, 3)) if faces is None else faces).astype(np.int32),
        points=points.astype(np.float32),
        point_faces=on[0].astype(np.int32),
        point_barycentrics=on[1].astype(np.float32),
        candidates="fps",
        center=(0.0, 0.0, 0.0),
        scale=1.0,
        repairs={},
    )


def on_mesh(vertices: np.ndarray, faces: np.ndarray, count: int, seed: int = 0) -> NormalizedShape:
    """A mesh with `count` evenly spread points on it."""
    rng = np.random.default_rng(seed)
    area = np.linalg.norm(
        np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]]), axis=1
    )
    cumulative = np.cumsum(area)
    at = np.searchsorted(cumulative, (np.arange(count) + rng.random(count)) / count * cumulative[-1])
    weights = rng.dirichlet([1, 1, 1], count)
    return shape(np.einsum("nc,ncx->nx", weights, vertices[faces[at]]), vertices, faces, (at, weights))


def sphere(count: int = 600) -> NormalizedShape:
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
    return on_mesh(np.asarray(ball.vertices), np.asarray(ball.faces), count)


def plate(thickness: float = 0.01, count: int = 1200) -> NormalizedShape:
    import trimesh

    box = trimesh.creation.box(extents=(1.0, thickness, 1.0)).subdivide().subdivide()
    return on_mesh(np.asarray(box.vertices), np.asarray(box.faces), count)


def as_cloud(mesh: NormalizedShape) -> NormalizedShape:
    return shape(mesh.points)


def solve(of: NormalizedShape, **params: object) -> np.ndarray:
    return geodesic(of, placed(GeodesicParams, **params)).distances.astype(np.float64)


def cloud(count: int = 300, seed: int = 0) -> np.ndarray:
    """A bumpy sheet: a surface, not a solid."""
    flat = np.random.default_rng(seed).random((count, 2))
    return np.column_stack([flat[:, 0], 0.1 * np.sin(6 * flat[:, 0]) * np.cos(6 * flat[:, 1]), flat[:, 1]])


# --- known distances


@pytest.mark.parametrize(
    ("on", "params", "tolerance"),
    [("mesh", {"method": "graph"}, 0.04), ("mesh", {"method": "graph", "shortcuts": "cut"}, 0.04),
     ("mesh", {"method": "heat"}, 0.02),
     ("cloud", {"method": "graph", "shortcuts": "cut"}, 0.04), ("cloud", {"method": "heat"}, 0.05)],
)  # fmt: skip
def test_great_circles_on_a_sphere(on: str, params: dict, tolerance: float) -> None:
    """Mean relative error beyond a tenth of the diameter, 600 points."""
    ball = sphere()
    unit = ball.points / np.linalg.norm(ball.points, axis=1, keepdims=True)
    true = 0.5 * np.arccos(np.clip(unit @ unit.T, -1, 1))
    far = true > 0.1
    found = solve(ball if on == "mesh" else as_cloud(ball), **params)
    assert np.abs(found[far] / true[far] - 1).mean() < tolerance


def test_straight_lines_on_a_plane() -> None:
    flat = np.random.default_rng(0).random((800, 2))
    points = np.column_stack([flat[:, 0], np.zeros(800), flat[:, 1]])
    true = cdist(points, points)
    found = solve(shape(points))
    assert (found >= true * (1 - HALF_PRECISION) - 1e-4).all()
    assert (found[true > 0.1] / true[true > 0.1]).mean() < 1.03


@pytest.mark.parametrize("neighbors", [1, 2, 20, 500])
def test_a_line_of_points_is_exact(neighbors: int) -> None:
    at = np.cumsum(np.random.default_rng(0).random(60)) / 30
    points = np.column_stack([at, 2 * at, -at]) / 6**0.5
    np.testing.assert_allclose(
        solve(shape(points), neighbors=neighbors), np.abs(at[:, None] - at), rtol=HALF_PRECISION, atol=1e-6
    )


def test_euclidean_is_the_straight_line() -> None:
    points = cloud()
    np.testing.assert_allclose(
        solve(shape(points), method="euclidean"), cdist(points, points), rtol=HALF_PRECISION, atol=1e-6
    )


def test_cutting_leaves_what_has_no_other_way() -> None:
    """Two parallel sheets without a rim stay connected; so does a patch whose winding is flipped."""
    sheet = np.random.default_rng(0).random((200, 2))
    points = np.concatenate([np.insert(sheet, 1, height, axis=1) for height in (0.0, 0.02)])
    normals = np.repeat([[0.0, -1, 0], [0, 1, 0]], 200, axis=0)
    edges, lengths = neighbour_edges(points, 20)
    kept, _ = cut_shortcuts(points, normals, True, edges, lengths)
    assert len(kept) == len(edges)
    flipped = np.where(points[:200, :1] > 0.5, 1.0, -1.0) * normals[:200]
    edges, lengths = neighbour_edges(points[:200], 20)
    assert len(cut_shortcuts(points[:200], flipped, True, edges, lengths)[0]) == len(edges)


def test_winding_is_trusted_only_where_consistent() -> None:
    ball = sphere()
    assert consistently_wound(ball.vertices, ball.faces)
    flip = np.random.default_rng(0).random(len(ball.faces)) < 0.3
    assert not consistently_wound(ball.vertices, np.where(flip[:, None], ball.faces[:, ::-1], ball.faces))
    assert not consistently_wound(ball.vertices, np.concatenate([ball.faces, ball.faces[:, ::-1]]))
    assert not consistently_wound(np.eye(3), np.array([[0, 1, 2]]))


# --- a metric, in any frame


@pytest.mark.parametrize("params", [{}, {"shortcuts": "cut"}, {"method": "heat"}], ids=str)
def test_symmetric_with_zero_diagonal_and_never_below_the_straight_line(params: dict) -> None:
    for of in (sphere(200), shape(cloud())):
        found = solve(of, **params)
        assert np.isfinite(found).all()
        np.testing.assert_array_equal(found, found.T)
        assert (np.diag(found) == 0).all()
        assert (found >= cdist(of.points, of.points) * (1 - HALF_PRECISION)).all()


def test_the_triangle_inequality() -> None:
    apart = np.concatenate([cloud(150), cloud(100) + np.array([0, 3, 0])])
    found = solve(shape(apart))
    detour = (found[:, :, None] + found[None]).min(axis=1)
    assert (found <= detour * (1 + HALF_PRECISION) + 1e-6).all()


@pytest.mark.parametrize("params", [{}, {"shortcuts": "cut"}, {"method": "heat"}], ids=str)
def test_order_rotation_and_scale(params: dict) -> None:
    points = cloud()
    found = solve(shape(points), **params)
    order = np.random.default_rng(1).permutation(len(points))
    np.testing.assert_allclose(solve(shape(points[order]), **params), found[np.ix_(order, order)], atol=2e-3)
    turned = Rotation.from_rotvec([0.3, -1.0, 2.0]).apply(points)
    if params.get("method") == "heat":  # potpourri3d's local triangulations of a cloud lean on the frame
        assert np.abs(solve(shape(turned), **params) - found).mean() < 0.01
    else:
        np.testing.assert_allclose(solve(shape(turned), **params), found, atol=2e-3)
    np.testing.assert_allclose(solve(shape(points * 2), **params), found * 2, atol=4e-3)


def test_heat_on_a_mesh_does_not_depend_on_the_frame() -> None:
    ball = sphere(200)
    rotation = Rotation.from_rotvec([0.3, -1.0, 2.0])
    turned = shape(
        rotation.apply(ball.points),
        rotation.apply(ball.vertices),
        ball.faces,
        (ball.point_faces, ball.point_barycentrics),
    )
    np.testing.assert_allclose(solve(turned, method="heat"), solve(ball, method="heat"), atol=5e-3)


# --- components


@pytest.mark.parametrize("method", ["graph", "heat"])
def test_two_components(method: str) -> None:
    left = cloud(100)
    both = shape(np.concatenate([left, left * [1, 1, -1] + [5, 0, 0]]))
    result = geodesic(both, placed(GeodesicParams, method=method, disconnected="infinite"))
    assert set(result.components[:100]) == {result.components[0]} != set(result.components[100:])
    inside = result.distances[:100, :100]
    assert np.isinf(result.distances[:100, 100:]).all()
    assert np.isfinite(inside).all()
    largest = solve(both, method=method, disconnected="max")
    assert (largest[:100, 100:] == largest[:100, :100].max()).all()

    bridged = solve(both, method=method)
    gap = cdist(both.points[:100], both.points[100:])
    near, far = np.unravel_index(gap.argmin(), gap.shape)
    through = bridged[:100, near][:, None] + gap.min() + bridged[None, 100 + far, 100:]
    tolerance = 2e-3 if method == "graph" else 0.03  # between components, heat's distances run along graph edges
    assert (bridged[:100, 100:] <= through * (1 + tolerance)).all() and (bridged[:100, 100:] >= gap * 0.998).all()
    np.testing.assert_allclose(bridged[near, 100 + far], gap.min(), rtol=2e-3)
    np.testing.assert_allclose(bridged[:100, :100], inside.astype(float), rtol=2e-3)


# --- degenerate input


@pytest.mark.parametrize("method", ["graph", "heat"])
@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_few_points(method: str, count: int) -> None:
    points = cloud(count)
    found = solve(shape(points), method=method)
    assert np.isfinite(found).all()
    assert (found >= cdist(points, points) * (1 - HALF_PRECISION) - 1e-6).all()


@pytest.mark.parametrize("method", ["graph", "heat"])
@pytest.mark.parametrize("disconnected", ["bridge", "max", "infinite"])
def test_coincident_points(method: str, disconnected: str) -> None:
    points = np.concatenate([cloud(60), np.repeat(cloud(60)[:1], 40, axis=0)])
    found = solve(shape(points), method=method, neighbors=5, disconnected=disconnected)
    assert not np.isnan(found).any()
    if disconnected == "bridge":
        assert np.abs(found[0, 60:]).max() < 1e-6
    assert (solve(shape(np.ones((30, 3))), method=method, disconnected=disconnected)[0, :5] == 0).all()


def test_heat_takes_dirty_meshes() -> None:
    """Unreferenced vertices, a fin on a non-manifold edge, faces that share no vertex index, an isolated sliver."""
    ball = sphere(150)
    fin = np.array([[0.0, 0, 0.9], [0.01, 0, 0.9], [0, 3.0, 0]])
    vertices = np.concatenate([[[9.0, 9, 9]], ball.vertices[ball.faces].reshape(-1, 3), fin])  # a triangle soup
    soup = 1 + np.arange(3 * len(ball.faces)).reshape(-1, 3)
    extra = np.array([[1, 2, len(vertices) - 3], [len(vertices) - 3, len(vertices) - 2, len(vertices) - 1]])
    faces = np.concatenate([soup, extra])
    last = len(faces) - 1
    dirty = shape(
        np.concatenate([ball.points, fin[:1] * 0.999, fin[:1]]),
        vertices,
        faces,
        (
            np.concatenate([ball.point_faces, [last, last]]),
            np.concatenate([ball.point_barycentrics, [[0.98, 0.01, 0.01], [1, 0, 0]]]),
        ),
    )
    result = geodesic(dirty, GeodesicParams(method="heat"))
    assert np.isfinite(result.distances).all()
    clean = solve(ball, method="heat")
    assert len(set(result.components[:150])) == 1
    np.testing.assert_allclose(result.distances[:150, :150].astype(float), clean, atol=0.05)


def test_errors_say_what_to_do() -> None:
    with pytest.raises(ValueError, match="at least one and all finite"):
        solve(shape(np.empty((0, 3))))
    with pytest.raises(ValueError, match="at least one and all finite"):
        solve(shape(np.array([[np.nan, 0, 0]])))
