"""Exchanges of names that annotated symmetries permit."""

from __future__ import annotations

import json

import numpy as np

from b23d.schemas.keypoints import Keypoints
from b23d.stages.scoring import symmetry
from b23d.stages.scoring.symmetry import fronts
from tests.shared_data import shared


def keypoints_at(positions: list[list[float]], **lists: list[tuple[int, ...]]) -> Keypoints:
    at = np.arange(len(positions), dtype=np.int32)
    return Keypoints(ids=at, positions=np.array(positions, float), point_indices=at, **lists)


def exchanges(keypoints: Keypoints) -> np.ndarray:
    return symmetry.exchanges(keypoints, keypoints.positions)


RECTANGLE = [[1.0, 0, 2], [1, 0, -2], [-1, 0, -2], [-1, 0, 2]]
EDGES = [(0, 1), (1, 2), (2, 3), (3, 0)]


def test_no_symmetry_is_the_identity_alone() -> None:
    assert exchanges(keypoints_at(RECTANGLE)).tolist() == [[0, 1, 2, 3]]


def test_pairs_of_one_mirror_are_exchanged_together() -> None:
    assert sorted(exchanges(keypoints_at(RECTANGLE, reflections=[(0, 3), (1, 2)])).tolist()) == [
        [0, 1, 2, 3],
        [3, 2, 1, 0],
    ]


def test_overlapping_pairs_are_sorted_into_planes() -> None:
    found = sorted(exchanges(keypoints_at(RECTANGLE, reflections=EDGES, rotations=[(0, 2), (1, 3)])).tolist())
    assert found == [[0, 1, 2, 3], [1, 0, 3, 2], [2, 3, 0, 1], [3, 2, 1, 0]]


def test_a_square_with_diagonal_mirrors_has_eight_symmetries() -> None:
    square = [[1.0, 0, 1], [1, 0, -1], [-1, 0, -1], [-1, 0, 1]]
    found = exchanges(keypoints_at(square, reflections=[*EDGES, (0, 2), (1, 3)], rotations=[(0, 1, 2, 3)]))
    assert len(found) == 8
    distances = np.linalg.norm(np.subtract(np.array(square)[:, None], np.array(square)[None]), axis=2)
    for names in found:
        assert np.allclose(distances[np.ix_(names, names)], distances)


def test_turns_alone() -> None:
    corners = [[np.cos(a), 0, np.sin(a)] for a in 2 * np.pi * np.arange(3) / 3]
    found = exchanges(keypoints_at(corners, rotations=[(0, 1, 2)])).tolist()
    assert found[0] == [0, 1, 2]
    assert sorted(found) == [[0, 1, 2], [1, 2, 0], [2, 0, 1]]


def test_gaps_of_the_lists_are_filled_from_positions_and_contradictions_dropped() -> None:
    upper = [[x, 1.0, z] for x, _, z in RECTANGLE]
    found = exchanges(keypoints_at(RECTANGLE + upper, reflections=[(0, 3), (1, 2)]))
    assert found.tolist() == [[0, 1, 2, 3, 4, 5, 6, 7], [3, 2, 1, 0, 7, 6, 5, 4]]
    turned = exchanges(keypoints_at(RECTANGLE + upper, rotations=[(0, 2), (1, 3), (4, 5)]))  # (4 5) is no half turn
    assert turned.tolist() == [[0, 1, 2, 3, 4, 5, 6, 7], [2, 3, 0, 1, 6, 7, 4, 5]]


def test_ids_that_the_shape_lacks_are_left_out() -> None:
    assert len(exchanges(keypoints_at(RECTANGLE, reflections=[(0, 3), (1, 2), (8, 9), (2, 12)]))) == 2


def test_listed_symmetries_of_real_shapes_keep_mutual_distances() -> None:
    for name, groups in (("airplane", {1, 2}), ("bathtub", {1, 2, 4}), ("bed", {1, 2, 4})):
        for one in json.loads(shared(f"keypointnet/annotations/{name}.json").read_text()):
            lists = {
                key: [tuple(entry["kp_indexes"]) for entry in one["symmetries"][key]]
                for key in ("reflection", "rotation")
            }
            truth = Keypoints(
                ids=np.array([keypoint["semantic_id"] for keypoint in one["keypoints"]], np.int32),
                positions=np.array([keypoint["xyz"] for keypoint in one["keypoints"]], float),
                point_indices=np.array(
                    [keypoint["pcd_info"]["point_index"] for keypoint in one["keypoints"]], np.int32
                ),
                reflections=lists["reflection"],
                rotations=lists["rotation"],
            )
            found = exchanges(truth)
            assert len(found) in groups
            distances = np.linalg.norm(truth.positions[:, None] - truth.positions[None], axis=2)
            for names in found:
                at = [truth.ids.tolist().index(i) for i in names]
                assert np.abs(distances[np.ix_(at, at)] - distances).max() < 0.15 * distances.max()


# --- either front -----------------------------------------------------------------------------------------------------


def test_a_half_turn_exchanges_front_and_back_and_left_and_right_at_once() -> None:
    bed = [[x, y, z] for x, z in ((1, 2), (1, -2), (-1, -2), (-1, 2)) for y in (0.0, 0.5 + 0.4 * (z > 0))]
    pillow = [0.3, 0.5, 1.5]
    names = np.arange(9, dtype=np.int32)
    assert fronts(names, np.array([*bed, pillow])).tolist() == [[*range(9)], [4, 5, 6, 7, 0, 1, 2, 3, 8]]


def test_the_half_turn_is_the_same_however_the_shape_stands_and_wherever() -> None:
    rng = np.random.default_rng(0)
    for seed in range(20):
        names = rng.permutation(12)[:10].astype(np.int32)
        half = np.random.default_rng(seed).uniform(0.2, 1, (5, 3)) * [1, 1, 2]
        upright = np.concatenate([half, half * [-1, 1, -1]]) + rng.normal(0, 0.03, (10, 3))
        sin, cos = np.sin(seed), np.cos(seed)
        elsewhere = 3 * upright @ np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]]).T + rng.normal(size=3)
        found = fronts(names, upright)
        assert np.array_equal(found, fronts(names, elsewhere))
        assert np.array_equal(fronts(found[1], upright)[1], names)  # twice is no turn at all


def test_few_keypoints_have_one_front() -> None:
    for count in (0, 1):
        names = np.arange(count, dtype=np.int32)
        assert fronts(names, np.zeros((count, 3))).tolist() == [names.tolist()] * 2
