"""normalize's turn: a source turned about the up axis, and its annotations with it."""

from __future__ import annotations

import numpy as np

from tests.made_shapes import of_cloud


def test_a_turned_source_turns_with_its_annotations_and_back() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(300, 3)) * (1.0, 2.0, 0.5) + 3
    plain, turned = of_cloud(points), of_cloud(points, turn=90.0)
    assert turned.turn == 90.0
    np.testing.assert_allclose(turned.to_unit(points), turned.vertices, atol=1e-6)
    np.testing.assert_allclose(turned.to_source(turned.vertices.astype(float)), points, atol=1e-5)
    np.testing.assert_allclose(plain.to_source(plain.to_unit(points)), points, atol=1e-12)
    x, y, z = plain.vertices.T  # the box is centred in both, so a quarter turn takes +z to +x and +x to -z
    np.testing.assert_allclose(turned.vertices, np.stack([z, y, -x], axis=1), atol=1e-6)


def test_random_turns_differ_by_shape_and_not_by_call() -> None:
    points = np.random.default_rng(0).normal(size=(50, 3))
    turns = [of_cloud(points, shape=name, turn="random").turn for name in ("box/a", "box/b", "box/a")]
    assert turns[0] == turns[2] != turns[1] and all(0 <= turn < 360 for turn in turns)
