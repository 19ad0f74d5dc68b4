"""Which way a shape faces: what tells it, what does not, and that a tie is called one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.stages.solvers.posterior.contrast import contrast, lying_along
from b23d.stages.solvers.posterior.geometry import Prepared, prepare, turned
from b23d.stages.solvers.posterior.options import PosteriorParams
from b23d.stages.solvers.posterior.turning import _log_prior, aligned, in_frame
from b23d.stages.solvers.posterior.weighing import weighed
from b23d.stages.solvers.scaling import relative_distances
from tests.test_posterior import PARAMS, Parts, box_cloud, run, taught

SEARCH = PosteriorParams()


def made(points: np.ndarray, looks: np.ndarray, at: np.ndarray, turn: float) -> Parts:
    """Points (n, 3) turned about the up axis, with features (n, channel) and keypoints at candidates `at`."""
    shape, features, distances, keypoints = box_cloud(0)
    sin, cos = np.sin(turn), np.cos(turn)
    points = (points @ np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]).T).astype(np.float32)
    gaps = np.linalg.norm(points[:, None] - points[None], axis=2).astype(np.float16)
    ids, where = np.arange(len(at), dtype=np.int32), {"positions": points[at].astype(float), "point_indices": at}
    every = {"counts": np.ones(len(points), np.int32), "observed": np.ones(len(points), bool)}
    return (
        shape.model_copy(update={"points": points, "vertices": points}),
        features.model_copy(update={"features": looks, **every}),
        distances.model_copy(update={"distances": gaps, "components": np.zeros(len(points), np.int32)}),
        keypoints.model_copy(update={"ids": ids, **where}),
    )


def symmetric(seed: int, turn: float = 0.0) -> Parts:
    """A box whose halves look alike: each point's feature is that of its counterpart across the vertical axis."""
    shape, features, _, _ = box_cloud(seed)
    points, looks, half = shape.points[8:208], features.features[8:208], 200
    at = np.array([0, 1, half, half + 1], np.int32)
    return made(np.concatenate([points, points * (-1, 1, -1)]), np.concatenate([looks, looks]), at, turn)


def chair(seed: int, turn: float) -> Parts:
    """A square seat with a back at -z; looks tell nothing, and the keypoints are the seat's corners."""
    rng = np.random.default_rng(seed)
    seat, back = rng.uniform(-0.5, 0.5, (300, 3)) * (1, 0, 1), rng.uniform(-0.5, 0.5, (150, 3)) * (1, 1, 0)
    corners = np.array([[x, 0.0, z] for x in (-0.5, 0.5) for z in (-0.5, 0.5)])
    points = np.concatenate([corners, seat, back + np.array([0, 0.5, -0.5])])
    return made(points, rng.normal(size=(len(points), 8)).astype(np.float16), np.arange(4, dtype=np.int32), turn)


def test_a_tie_between_fronts_is_called_one_and_decided_alike_each_time() -> None:
    shots = [symmetric(0, 2.1 * i) for i in range(3)]
    found, again, clear = run(symmetric(0, 1.0), shots), run(symmetric(0, 1.0), shots), run(box_cloud(7, 1.0), BOXES)
    np.testing.assert_array_equal(found.points, again.points)
    assert found.front_margin is not None and clear.front_margin is not None
    assert found.front_margin == pytest.approx(0, abs=0.5) and clear.front_margin > 30
    assert found.confidence is not None and clear.confidence is not None
    assert found.confidence.max() < clear.confidence.min()


BOXES = [box_cloud(i, turn=2.1 * i) for i in range(3)]


def test_what_is_as_probable_as_its_front_is_shared_among_fronts() -> None:
    learned = weighed(taught([symmetric(0, 2.1 * i) for i in range(3)]), np.ones(3))
    shape, described, geodesic, _ = symmetric(0, 1.0)
    lengths = relative_distances(geodesic.distances)
    target = prepare(shape.points, described.features.astype(np.float32), lengths, PARAMS.radii)
    stood = in_frame(learned, target, SEARCH)
    assert stood.share + sum(share for share, _ in stood.others) == pytest.approx(1)
    assert 0.1 < stood.share <= 0.51, "the half turn is as good"


def test_no_front_is_looked_for_where_several_shots_stand_alike() -> None:
    assert run(box_cloud(7), [box_cloud(i) for i in range(3)]).front_margin is None


@pytest.mark.parametrize("count", [1, 2])
def test_a_shot_or_two_may_stand_alike_by_chance(count: int) -> None:
    """A target that much speaks for turning is turned; one that little speaks for stays as it is."""
    shots = [box_cloud(i) for i in range(count)]
    for turn in (0.0, 1.6):
        found = run(box_cloud(7, turn), shots)
        assert np.linalg.norm(found.positions - box_cloud(7, turn)[3].positions, axis=1).max() < 0.1
    learned = weighed(taught([symmetric(0)] * count), np.ones(count))
    shape, described, geodesic, _ = symmetric(0, np.pi)
    lengths = relative_distances(geodesic.distances)
    target = prepare(shape.points, described.features.astype(np.float32), lengths, PARAMS.radii)
    assert in_frame(learned, target, SEARCH).shape is target


@pytest.mark.parametrize("turn", [1.0, 2.6, 4.2])
def test_where_the_surface_lies_tells_the_front(turn: float) -> None:
    shots, target = [chair(i, 2.1 * i) for i in range(3)], chair(7, turn)
    found = run(target, shots, contrast_weight=0.0)
    blind = run(target, shots, contrast_weight=0.0, surface_weight=0.0)
    assert found.front_margin is not None and blind.front_margin is not None
    assert found.front_margin > 20 > blind.front_margin
    assert np.linalg.norm(found.positions - target[3].positions, axis=1).max() < 0.25


def painted(seed: int, turn: float) -> Parts:
    """A long box with a keypoint at every corner of its middle; what lies beyond +z looks otherwise, beyond -z not."""
    rng = np.random.default_rng(seed)
    corners = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.2, 0.2) for z in (-0.1, 0.1)])
    half = rng.uniform(-0.5, 0.5, (300, 3)) * (0.6, 0.4, 1)
    points = np.concatenate([corners, half, half * (-1, 1, -1)])
    looks = rng.normal(size=(len(points), 8)) + 2.0 * np.eye(8)[3] * (points[:, 2:] > 0.3)
    looks[:8] = np.random.default_rng(0).normal(size=(4, 8))[[0, 1, 2, 3, 1, 0, 3, 2]]  # as their counterparts do
    return made(points, looks.astype(np.float16), np.arange(8, dtype=np.int32), turn)


@pytest.mark.parametrize("turn", [1.0, 2.6, 4.2])
def test_what_no_keypoint_shows_tells_the_front(turn: float) -> None:
    shots, target = [painted(i, 2.1 * i) for i in range(3)], painted(7, turn)
    found, blind = run(target, shots), run(target, shots, contrast_weight=0.0)
    assert found.front_margin is not None and blind.front_margin is not None
    assert found.front_margin > blind.front_margin + 10
    assert np.linalg.norm(found.positions - target[3].positions, axis=1).max() < 0.1


def seen(parts: Parts) -> Prepared:
    shape, described, geodesic, _ = parts
    lengths = relative_distances(geodesic.distances)
    return prepare(shape.points, described.features.astype(np.float32), lengths, PARAMS.radii)


def told(shape: Prepared, along: float) -> np.ndarray:
    """The shape's contrast, in the features' own channels and the geometry as it is."""
    channels, every = shape.features.shape[1], shape.features.shape[1] + shape.geometry.shape[1]
    return contrast(
        shape, np.eye(channels, dtype=np.float32), np.zeros(every, np.float32), np.ones(every, np.float32), along
    )


@settings(max_examples=20, deadline=None)
@given(st.floats(-np.pi, np.pi), st.floats(0, np.pi / 2))
def test_turned_half_round_the_contrast_is_the_negative(turn: float, along: float) -> None:
    shape = seen(chair(0, turn))
    there, back = told(shape, along), told(turned(shape, np.pi), along)
    np.testing.assert_allclose(there, -back, atol=1e-4)
    assert 0.1 < np.linalg.norm(there) <= np.sqrt(2)


def test_a_shape_that_a_half_turn_takes_to_itself_has_no_contrast() -> None:
    assert np.abs(told(seen(symmetric(0)), 0.3)).max() < 1e-4


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 179))
def test_a_box_is_turned_to_lie_along_its_axes(degrees: int) -> None:
    rng = np.random.default_rng(0)
    box = rng.uniform(-0.5, 0.5, (2000, 3)) * (0.4, 0.3, 1)
    shape = seen(made(box[:400], np.ones((400, 8), np.float16), np.arange(4, dtype=np.int32), np.deg2rad(degrees)))
    left = np.rad2deg(lying_along([shape])) + degrees
    assert min(left % 90, -left % 90) <= 6


@pytest.mark.parametrize("turn", [0.7, 1.6, 3.1])
def test_a_target_that_clearly_stands_otherwise_is_turned_where_the_shots_stand_alike(turn: float) -> None:
    shots = [chair(i, 0.0) for i in range(3)]
    for stands in (0.0, turn):
        target = chair(7, stands)
        found = run(target, shots)
        assert (found.front_margin is None) == (stands == 0)
        assert np.linalg.norm(found.positions - target[3].positions, axis=1).max() < 0.25


def test_of_fronts_that_tie_the_nearer_is_taken_where_the_shots_stand_alike() -> None:
    target = symmetric(0, 0.7)
    found = run(target, [symmetric(0)] * 3)
    assert found.front_margin == pytest.approx(0, abs=1), "that the nearer is presumed is no evidence"
    assert np.linalg.norm(found.positions - target[3].positions, axis=1).max() < 0.1


def few(places: list[list[float]]) -> Prepared:
    """A shape of which only the keypoints matter."""
    points = np.array([*places, [-0.5, -0.5, -0.5], [0.5, 0.5, 0.5]], np.float32)
    ids, gaps = np.arange(len(places)), np.zeros((len(points), len(points)), np.float32)
    return prepare(points, np.eye(len(points), dtype=np.float32), relative_distances(gaps), PARAMS.radii, ids, ids)


def test_two_near_keypoints_that_lie_otherwise_are_no_turn_and_far_ones_are() -> None:
    near = [few([[0, 0.3, 0], [0.05, 0.3, 0]]), few([[0, 0.3, 0], [0, 0.3, 0.05]])]
    far = [few([[-0.4, 0.3, 0], [0.4, 0.3, 0]]), few([[0, 0.3, -0.4], [0, 0.3, 0.4]])]
    assert not aligned(near, PARAMS.same_frame)[1].any()
    assert np.abs(aligned(far, PARAMS.same_frame)[1]).max() == pytest.approx(np.pi / 2, abs=1e-6)


@settings(max_examples=20, deadline=None)
@given(st.floats(-np.pi, np.pi), st.floats(1.0, 2.0))
def test_only_turns_that_shots_share_are_expected_again(first: float, step: float) -> None:
    angles = np.linspace(-np.pi, np.pi, 24)
    each_its_own = _log_prior(angles, first + step * np.arange(3), SEARCH)
    shared = _log_prior(np.array([first]), np.array([first, first, first + step]), SEARCH)
    assert np.ptp(each_its_own) < 0.1 and shared[0] > 2
    np.testing.assert_array_equal(_log_prior(angles, np.array([first]), SEARCH), 0)
