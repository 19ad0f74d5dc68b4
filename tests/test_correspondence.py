"""Dense correspondence: a shape matches itself, in any order of its points; a mirror changes sides and nothing else."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

from b23d.stages.correspondence.functional import eigenfunctions, refined
from b23d.stages.correspondence.landmarks import guesses
from b23d.stages.correspondence.matching import correspond
from b23d.stages.correspondence.sides import side_channels
from b23d.stages.correspondence.surfaces import FeaturedSurface, cosines
from b23d.stages.datasets.procedural.figures import CHILD, WALKING, WAVING, figure
from b23d.stages.workbench.analyses.correspondence import Parameters, analyse
from b23d.stages.workbench.analyses.interface import ExecutedMember

rng = np.random.default_rng(0)
POINTS = rng.uniform(size=(150, 3)) * (1.0, 0.6, 0.3)
FEATURES = rng.normal(size=(150, 8))


def ellipsoid(n: int = 400) -> FeaturedSurface:
    """With a feature that grows upwards, one that grows to the front, and one that does not tell left from right."""
    turn, height = np.pi * (1 + 5**0.5) * np.arange(n), 1 - (2 * np.arange(n) + 1) / n
    across = np.sqrt(1 - height**2)
    points = np.stack([0.3 * across * np.cos(turn), 0.5 * height, 0.4 * across * np.sin(turn)], axis=1)
    x, y, z = points.T
    return FeaturedSurface(points, np.stack([y, z, np.abs(x), y * z], axis=1), cdist(points, points))


@pytest.mark.parametrize("method", ["nearest", "consistent", "smooth"])
def test_a_shape_matches_itself_in_any_order(method: str) -> None:
    shape = replace(ellipsoid(), features=rng.normal(size=(400, 8)))
    order = rng.permutation(400)
    other = FeaturedSurface(shape.points[order], shape.features[order], shape.distances[np.ix_(order, order)])
    found = correspond(shape, other, method)  # type: ignore[arg-type]
    assert (order[found] == np.arange(400)).all()


def test_distances_tell_apart_what_looks_alike() -> None:
    """Features that confuse each point with another at random: only distances can be consistent."""
    distances = cdist(POINTS, POINTS)
    other = np.where(rng.random(150) < 0.4, rng.permutation(150), np.arange(150))
    confused = cosines(FEATURES, FEATURES)
    confused[np.arange(150), other] = 1.05
    assert (confused.argmax(axis=1) != np.arange(150)).mean() > 0.3
    assert (guesses(confused, distances, distances)[0][1] == np.arange(150)).mean() > 0.95


def test_a_mirror_negates_sides_and_a_turn_keeps_them() -> None:
    shape = ellipsoid()
    mirrored = replace(shape, points=shape.points * (-1.0, 1.0, 1.0))
    turned = replace(shape, points=Rotation.from_euler("xyz", (20, 130, 50), degrees=True).apply(shape.points))
    own, theirs = side_channels(shape, mirrored)
    assert np.abs(own + theirs).max() < 1e-4 * np.abs(own).max()
    own, theirs = side_channels(shape, turned)
    assert np.abs(own - theirs).max() < 1e-4 * np.abs(own).max()
    assert np.isclose((own**2).sum(axis=1).mean(), 1, rtol=1e-4)


def test_left_is_told_from_right_where_looks_and_distances_do_not() -> None:
    shape = ellipsoid()
    order = rng.permutation(400)
    other = FeaturedSurface(
        Rotation.from_euler("y", 100, degrees=True).apply(shape.points)[order],
        shape.features[order], shape.distances[np.ix_(order, order)],
    )  # fmt: skip
    found = shape.points[order[correspond(shape, other, "consistent")]]
    beside = np.abs(shape.points[:, 0]) > 0.1
    same = np.sign(found[:, 0]) == np.sign(shape.points[:, 0])
    assert same[beside].mean() > 0.95


def test_refinement_mends_a_rough_map_and_keeps_the_identity() -> None:
    shape = ellipsoid()
    waves = eigenfunctions(shape.points)
    assert (refined(np.arange(400), waves, waves) == np.arange(400)).all()
    rough = shape.distances.argsort(axis=1)[np.arange(400), rng.integers(0, 12, 400)]
    errors = [shape.distances[np.arange(400), matched].mean() for matched in (rough, refined(rough, waves, waves))]
    assert errors[1] < errors[0] / 2


def test_unconnected_points_are_far_but_not_infinitely() -> None:
    distances = cdist(POINTS, POINTS)
    distances[:75, 75:] = distances[75:, :75] = np.inf
    reach = FeaturedSurface(POINTS, FEATURES, distances).reach()
    assert np.isfinite(reach).all() and reach[0, 100] == np.float32(distances[np.isfinite(distances)].max())


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


LINE = np.linspace(0, 1, 20)[:, None] * (1.0, 2.0, 3.0)


@pytest.mark.parametrize(
    ("points", "told"), [(np.repeat(POINTS[:7], 3, axis=0), "8 different points"), (LINE, "got all on a line")]
)
def test_what_has_no_surface_is_told_which_shape_it_is(points: np.ndarray, told: str) -> None:
    whole = ellipsoid(60)
    flat = FeaturedSurface(points, rng.normal(size=(len(points), 4)), cdist(points, points))
    for pair, which in (((whole, flat), "second"), ((flat, whole), "first")):
        with pytest.raises(ValueError, match=f"the {which} shape: cloud: expected .*{told}"):
            correspond(*pair, "smooth")


def pair_of(*found: tuple[str, FeaturedSurface | None]) -> ExecutedMember:
    """Shapes, `class/name`, and what a run has of them; None: it failed beyond its candidates."""
    part = ExecutedMember("features", "", cast(Any, None))
    part.__dict__["entries"] = {
        name: SimpleNamespace(
            shape=SimpleNamespace(category=name.split("/")[0], name=name),
            normalized=SimpleNamespace(points=POINTS),
            features=one and SimpleNamespace(features=one.features, observed=np.ones(len(one.points), bool)),
            distances=one and SimpleNamespace(distances=one.distances),
        )
        for name, one in found
    }
    return part


def test_a_pair_that_failed_leaves_the_others() -> None:
    apart = cdist(POINTS, POINTS)
    apart[:75, 75:] = apart[75:, :75] = np.inf
    good = FeaturedSurface(POINTS, FEATURES, apart)
    part = pair_of(("a/0", good), ("a/1", good), ("b/0", good), ("b/1", None), ("c/0", good))
    result = analyse([part], Parameters(kind="correspondence"))
    assert set(result.table["pair"]) == {"a"} and np.isfinite(result.table["error"]).all()
    assert "Left out: features: b/1: expected features" in result.note and "c: expected two shapes" in result.note
    with pytest.raises(ValueError, match="b/1: expected features and distances, got none"):
        analyse([pair_of(("b/0", good), ("b/1", None))], Parameters(kind="correspondence"))
