"""The posterior method on made-up shapes: it recovers what it was taught, does not care about order, and knows when
frames differ."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.predictions import Prediction
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.shot_model import ShotModel
from b23d.stages.learn import learn
from b23d.stages.optimize import optimize
from b23d.stages.solvers.learn_options import LearnParams
from b23d.stages.solvers.likeness import occupancy
from b23d.stages.solvers.posterior.geometry import Prepared, local_geometry, prepare
from b23d.stages.solvers.posterior.learning import deformation_covariance, frame_gate
from b23d.stages.solvers.posterior.options import PosteriorParams
from b23d.stages.solvers.posterior.turning import aligned, in_frame, turned
from b23d.stages.solvers.posterior.weighing import weighed
from b23d.stages.solvers.scaling import relative_distances
from tests.made_params import of_learn_and_optimize

PARAMS = LearnParams()
Parts = tuple[NormalizedShape, PointFeatures, GeodesicDistances, Keypoints]


def box_cloud(seed: int, turn: float = 0.0, keypoints: int = 8) -> Parts:
    """A noisy box cloud whose features are smooth functions of place; keypoints at its corners; turned about the up
    axis."""
    rng = np.random.default_rng(seed)
    sides = np.array([1.0, 0.6, 0.35]) * rng.uniform(0.9, 1.1, 3)
    points = rng.uniform(-0.5, 0.5, (400, 3))
    axis = rng.integers(0, 3, 400)
    points[np.arange(400), axis] = np.sign(points[np.arange(400), axis]) / 2
    corners = np.array(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5])).reshape(3, 8).T
    points[:8] = corners
    basis = np.random.default_rng(99).normal(size=(3, 24))
    features = np.concatenate([np.sin(3 * points @ basis), 0.02 * rng.normal(size=(400, 8))], 1)
    rotation = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    points = ((points * sides) @ rotation.T).astype(np.float32)
    distances = np.linalg.norm(points[:, None] - points[None], axis=2).astype(np.float16)
    ids = np.arange(keypoints, dtype=np.int32)
    shape = NormalizedShape(
        kind="cloud",
        vertices=points,
        faces=np.zeros((0, 3), np.int32),
        points=points,
        point_faces=np.full(400, -1, np.int32),
        point_barycentrics=np.zeros((400, 3), np.float32),
        candidates="cloud",
        center=(0, 0, 0),
        scale=1.0,
        repairs={},
    )
    described = PointFeatures(
        features=features.astype(np.float16),
        counts=np.ones(400, np.int32),
        observed=np.ones(400, bool),
        descriptor="made up",
    )
    geodesic = GeodesicDistances(distances=distances, components=np.zeros(400, np.int32), method="euclidean")
    return shape, described, geodesic, Keypoints(ids=ids, positions=points[ids].astype(np.float64), point_indices=ids)


def run(target: Parts, shots: list[Parts], **params: object) -> Prediction:
    teaching, search = of_learn_and_optimize(**params)
    return optimize(target[0], target[1], target[2], taught(shots, teaching), search)


def taught(shots: list[Parts], params: LearnParams = PARAMS) -> ShotModel:
    return learn(*(list(column) for column in zip(*shots, strict=True)), params)  # type: ignore[arg-type]


def test_it_recovers_keypoints_of_a_class() -> None:
    found = run(box_cloud(7), [box_cloud(i) for i in range(3)])
    truth = box_cloud(7)[3].positions
    assert np.linalg.norm(found.positions - truth, axis=1).max() < 0.1
    assert found.present.all()


def test_a_shot_as_target_gets_its_own_keypoints() -> None:
    found = run(box_cloud(0), [box_cloud(0)])
    assert np.linalg.norm(found.positions - box_cloud(0)[3].positions, axis=1).max() < 0.1


def test_the_order_of_candidates_does_not_matter() -> None:
    shape, described, geodesic, keypoints = box_cloud(7)
    order = np.random.default_rng(1).permutation(400)
    shuffled = (
        shape.model_copy(update={"points": shape.points[order]}),
        described.model_copy(update={"features": described.features[order]}),
        geodesic.model_copy(update={"distances": geodesic.distances[np.ix_(order, order)]}),
        keypoints,
    )
    shots = [box_cloud(i) for i in range(3)]
    np.testing.assert_array_equal(run(box_cloud(7), shots).points, order[run(shuffled, shots).points])


def test_the_same_again() -> None:
    shots = [box_cloud(i) for i in range(3)]
    one, two = run(box_cloud(5), shots), run(box_cloud(5), shots)
    np.testing.assert_array_equal(one.points, two.points)
    assert one.objective == two.objective


@pytest.mark.parametrize("turn", [0.0, 1.0, 4.5])
def test_shapes_turned_each_their_own_way_are_turned_onto_each_other(turn: float) -> None:
    shots = [box_cloud(i, turn=2.1 * i) for i in range(3)]
    found = run(box_cloud(7, turn), shots)
    assert np.linalg.norm(found.positions - box_cloud(7, turn)[3].positions, axis=1).max() < 0.1


def prepared(seed: int, turn: float = 0.0) -> Prepared:
    shape, described, geodesic, keypoints = box_cloud(seed, turn)
    return prepare(
        shape.points,
        described.features.astype(np.float32),
        relative_distances(geodesic.distances),
        PARAMS.radii,
        keypoints.ids,
        keypoints.point_indices,
    )


def test_shots_that_stand_alike_are_left_alone() -> None:
    shots = [prepared(i, turn=0.1 * i) for i in range(3)]
    same, turns = aligned(shots, PARAMS.same_frame)
    assert not turns.any() and all(one is other for one, other in zip(same, shots, strict=True))
    target, model = prepared(7), taught([box_cloud(i, turn=0.1 * i) for i in range(3)])
    assert in_frame(weighed(model, np.ones(3)), target, PosteriorParams()).shape is target


def test_the_odd_shot_is_turned_to_the_others_and_not_they_to_it() -> None:
    _, turns = aligned([prepared(0, turn=1.0), prepared(1), prepared(2)], PARAMS.same_frame)
    assert turns[1] == turns[2] == 0 and turns[0] == pytest.approx(-1.0, abs=0.1)


@settings(max_examples=20, deadline=None)
@given(st.floats(-np.pi, np.pi), st.floats(-np.pi, np.pi))
def test_turns_add_up(one: float, other: float) -> None:
    shape = prepared(3)
    twice, once = turned(turned(shape, one), other), turned(shape, one + other)
    for name in ("position", "sides", "shift"):
        np.testing.assert_allclose(getattr(twice, name), getattr(once, name), atol=2e-5)
    assert twice.diameter == pytest.approx(once.diameter, rel=1e-4)


def test_keypoints_on_the_axis_tell_no_turn() -> None:
    """Of a bottle, say: any angle would do, and none is taken."""
    shots = []
    for i in range(3):
        line = np.column_stack([np.zeros(5), np.linspace(-0.5, 0.5, 5), np.zeros(5)])
        points = line + 1e-3 * np.random.default_rng(i).normal(size=(5, 3))
        ids, gaps = np.arange(5), np.abs(np.subtract.outer(points[:, 1], points[:, 1])).astype(np.float32)
        lengths = relative_distances(gaps)
        shots.append(prepare(points.astype(np.float32), np.eye(5, dtype=np.float32), lengths, PARAMS.radii, ids, ids))
    assert not aligned(shots, PARAMS.same_frame)[1].any()


def gate(turns: list[float]) -> float:
    places = []
    for i, turn in enumerate(turns):
        shape, described, geodesic, keypoints = box_cloud(i, turn)
        lengths = relative_distances(geodesic.distances)
        made = prepare(shape.points, described.features.astype(np.float32), lengths, PARAMS.radii)
        places.append(made.box[keypoints.point_indices])
    return frame_gate(np.array(places, float), np.ones((len(turns), 8), bool), PARAMS)


def test_the_gate_tells_aligned_shapes_from_turned_ones() -> None:
    assert gate([0.0, 0.0, 0.0]) < 1.2
    assert gate([0.0, 2.1, 4.0]) > 3
    assert gate([1.0]) == 1.0


def test_local_geometry_does_not_change_under_turns_about_up() -> None:
    points = box_cloud(3)[0].points
    turned = box_cloud(3, turn=1.234)[0].points
    np.testing.assert_allclose(
        local_geometry(points, PARAMS.radii)[1], local_geometry(turned, PARAMS.radii)[1], atol=1e-2
    )


def test_local_geometry_is_that_of_all_points_weighted() -> None:
    """Against sums over all pairs in double precision; one point is so far off that nothing else weighs there."""
    points = np.random.default_rng(0).normal(0, 0.2, (300, 3))
    points[7] = 9
    weights = np.exp(-((points[:, None] - points) ** 2).sum(2) / (2 * (0.1 / 1.5) ** 2))
    mass = weights.sum(1, keepdims=True)
    shift = (weights @ points / mass - points) / 0.1
    shifts, described = local_geometry(points.astype(np.float32), (0.1,))
    np.testing.assert_allclose(shifts, shift, atol=1e-4)
    np.testing.assert_allclose(described[:, 0], np.linalg.norm(shift, axis=1), atol=1e-4)
    np.testing.assert_allclose(described[:, 5:], np.log(mass) - np.log(mass).mean(), atol=1e-4)
    for i in (0, 150, 299):
        values = np.linalg.eigvalsh(np.cov(points.T, aweights=weights[i], bias=True))
        np.testing.assert_allclose(described[i, 2:5], np.sqrt(values) / 0.1, atol=2e-3)


def test_the_prior_is_a_covariance() -> None:
    covariance = deformation_covariance(np.random.default_rng(0).uniform(-0.5, 0.5, (12, 3)), PARAMS.deformation)
    np.testing.assert_allclose(covariance, covariance.T)
    assert np.linalg.eigvalsh(covariance).min() > 0


@pytest.mark.parametrize("presence", ["all", "evidence"])
def test_what_shots_and_target_show_is_present(presence: str) -> None:
    shots = [box_cloud(i) for i in range(3)]
    found = run(box_cloud(7), shots, presence=presence)
    assert found.present.all()


def test_confidence_is_that_of_the_place() -> None:
    """A shot found on itself is surer than what looks like nothing; other methods claim none."""
    shots = [box_cloud(0), box_cloud(1), box_cloud(2)]
    shape, described, geodesic, keypoints = box_cloud(3)
    solid = np.random.default_rng(0).uniform(-0.5, 0.5, shape.points.shape).astype(np.float32)
    nothing = (
        shape.model_copy(update={"points": solid, "vertices": solid}),
        described.model_copy(update={"features": np.ones_like(described.features)}),
        geodesic.model_copy(update={"distances": np.linalg.norm(solid[:, None] - solid, axis=2).astype(np.float16)}),
        keypoints,
    )
    itself, other = run(shots[0], shots), run(nothing, shots)
    for found in (itself, other):
        assert found.confidence is not None and (found.confidence >= 0).all() and (found.confidence <= 1 + 1e-5).all()
    assert itself.confidence is not None and other.confidence is not None
    assert itself.confidence.mean() > other.confidence.mean()
    assert run(shots[0], shots, method="nearest").confidence is None


# the shots' model


def test_the_model_is_the_same_for_every_method_and_lies_open() -> None:
    """What people look at is what the shots come to where each counts alike."""
    model = taught([box_cloud(i) for i in range(3)])
    alike = weighed(model, np.ones(3))
    for name, found in (
        ("keypoint", alike.keypoint),
        ("identity", alike.identity),
        ("mean_places", alike.places),
        ("mean_distances", alike.distances),
    ):
        np.testing.assert_allclose(getattr(model, name), found, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(model.mean_places, model.places.mean(0), atol=1e-6)
    np.testing.assert_allclose(np.abs(model.mean_places), 0.5, atol=1e-3)  # corners
    np.testing.assert_allclose(model.occupancy.sum(1), 1, atol=1e-5)
    assert (model.has.all(), model.gate, model.shots) == (True, 1.0, ["0", "1", "2"])


def test_a_shot_that_counts_not_at_all_is_as_if_it_had_no_keypoints() -> None:
    shots = [box_cloud(i, keypoints=6 + i) for i in range(3)]
    model = taught(shots)
    two = weighed(model, np.array([1.0, 1.0, 0.0]))
    assert two.has.shape == (2, 7), "id 7 is the third's alone"
    np.testing.assert_allclose(two.places[:6], model.places[:2, :6].mean(0), atol=1e-6)
    np.testing.assert_allclose(two.places[6], model.places[1, 6], atol=1e-6)
    twice = weighed(model, np.array([2.0, 2.0, 0.0]))
    for name in ("keypoint", "identity", "places", "shifts", "distances", "log_sides"):
        np.testing.assert_allclose(getattr(two, name), getattr(twice, name), rtol=1e-6, err_msg=name)


def test_a_shot_without_keypoints_teaches_nothing() -> None:
    shots = [box_cloud(0), box_cloud(1), box_cloud(2, turn=1.0, keypoints=0)]
    with_it, without = taught(shots), taught(shots[:2])
    for name in ("ids", "keypoint", "identity", "mean_places", "mean_distances", "covariance", "basis", "deviations"):
        np.testing.assert_array_equal(getattr(with_it, name), getattr(without, name), err_msg=name)
    assert with_it.shots == ["0", "1", "2"] and not with_it.has[2].any() and with_it.gate == without.gate
    np.testing.assert_array_equal(run(box_cloud(7), shots).points, run(box_cloud(7), shots[:2]).points)


def test_shots_are_turned_into_one_frame_and_say_by_how_much() -> None:
    model = taught([box_cloud(0), box_cloud(1), box_cloud(2, turn=1.0)])
    assert model.turns[:2].tolist() == [0, 0] and model.turns[2] == pytest.approx(-1.0, abs=0.1)
    np.testing.assert_allclose(model.places[2], model.places[0], atol=0.05)
    np.testing.assert_allclose(model.sides[2], model.sides[0], atol=0.1)


def test_occupancy_is_the_share_of_each_cell() -> None:
    points = np.array([[-0.5, -0.5, -0.5], [0.5, 0.5, 0.5], [0.5, 0.5, 0.49], [-0.5, -0.45, -0.31]], np.float32)
    found = occupancy(points)
    assert {int(i): float(found[i]) for i in np.flatnonzero(found)} == {0: 0.25, 999: 0.5, 1: 0.25}


def test_what_an_export_moves_into_a_target_s_file_frame_is_no_shot_s() -> None:
    """Exports take what is in the "unit frame" for that of the shape they are asked of; a shots' model has none."""
    assert not {name for name, spec in ShotModel.array_specs().items() if spec.unit == "unit frame"}
