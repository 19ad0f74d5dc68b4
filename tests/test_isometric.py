"""The two isometric cubes: every edge as long in one as in the other, closed, and yet different."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from b23d.stages.datasets.procedural.isometric import isometric_cubes


def edges(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vertices[faces] - vertices[np.roll(faces, -1, axis=1)], axis=-1)


def test_connectivity_and_every_edge_agree_exactly() -> None:
    inwards, outwards = isometric_cubes()
    np.testing.assert_array_equal(inwards.faces, outwards.faces)
    np.testing.assert_array_equal(edges(inwards.vertices, inwards.faces), edges(outwards.vertices, outwards.faces))


def test_both_are_closed_and_their_volumes_differ_by_twice_the_dent() -> None:
    depth, reach = 0.2, 0.36
    inwards, outwards = (
        trimesh.Trimesh(s.vertices, s.faces, process=False) for s in isometric_cubes(cells=64, depth=depth, reach=reach)
    )
    assert inwards.is_watertight and outwards.is_watertight
    assert inwards.volume + outwards.volume == pytest.approx(2.0)
    # the integral of depth (1 - r²/R²)² over the disc of radius R is π R² depth / 3
    assert outwards.volume - inwards.volume == pytest.approx(2 * np.pi * reach**2 * depth / 3, rel=2e-3)


def test_only_the_dent_differs() -> None:
    inwards, outwards = isometric_cubes(reach=0.3)
    moved = (inwards.vertices != outwards.vertices).any(1)
    assert moved.any()
    assert np.hypot(*inwards.vertices[moved][:, [0, 2]].T).max() < 0.3


def test_a_dent_too_large_is_an_error() -> None:
    with pytest.raises(ValueError, match=r"reach < 0\.5"):
        isometric_cubes(reach=0.5)
