"""Dense correspondence: a shape matches itself, in any order of its points; figures correspond."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.distance import cdist

from b23d.stages.datasets.procedural.figures import CHILD, WALKING, WAVING, figure
from b23d.stages.geometry.correspondence import consistent, cosines

rng = np.random.default_rng(0)
POINTS = rng.uniform(size=(150, 3)) * (1.0, 0.6, 0.3)
FEATURES = rng.normal(size=(150, 8))


def test_a_shape_matches_itself() -> None:
    distances = cdist(POINTS, POINTS)
    assert (consistent(cosines(FEATURES, FEATURES), distances, distances) == np.arange(150)).all()


def test_order_does_not_matter() -> None:
    order = rng.permutation(150)
    distances = cdist(POINTS, POINTS)
    found = consistent(cosines(FEATURES, FEATURES[order]), distances, distances[np.ix_(order, order)])
    assert (order[found] == np.arange(150)).all()


def test_distances_tell_apart_what_looks_alike() -> None:
    """Features that confuse each point with its mirror image at random: only distances can be consistent."""
    distances = cdist(POINTS, POINTS)
    image = rng.permutation(150)
    image = np.where(rng.random(150) < 0.4, image, np.arange(150))
    confused = cosines(FEATURES, FEATURES)
    confused[np.arange(150), image] = 1.05
    assert (confused.argmax(axis=1) != np.arange(150)).mean() > 0.3
    assert (consistent(confused, distances, distances) == np.arange(150)).mean() > 0.95


@pytest.mark.parametrize("pose", [WALKING, WAVING])
def test_figures_correspond_and_stand_symmetrically(pose: object) -> None:
    standing = figure()
    for other in (figure(pose), figure(pose, CHILD)):  # type: ignore[arg-type]
        assert np.array_equal(standing.faces, other.faces) and standing.vertices.shape == other.vertices.shape
    mirrored = standing.vertices * (-1.0, 1.0, 1.0)
    assert cdist(mirrored, standing.vertices).min(axis=1).max() < 1e-9
    one, two = (solid.vertices[standing.faces] for solid in (standing, figure(pose)))
    edges = [np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2) for corners in (one, two)]
    assert np.median(np.abs(edges[0] / edges[1] - 1)) < 0.1, "a pose keeps most lengths"
