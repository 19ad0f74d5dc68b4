"""Repairs of meshes: each counted, none of them moves what is kept."""

from __future__ import annotations

import numpy as np

from b23d.schemas.shape import Source
from b23d.stages.geometry.cleaning import fill_gaps
from b23d.stages.normalize import NormalizeParams, normalize
from tests.made_shapes import BOX, ROUGH, of_cloud, of_mesh, on_surface
from tests.shared_data import shared


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
