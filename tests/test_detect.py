"""detect: keypoints without names, by detectors whose scale and count are calibrated on the shots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from b23d.pipeline.run import Run
from b23d.schemas.features import GeodesicDistances
from b23d.schemas.predictions import Prediction
from b23d.stages.detectors.calibration import AnnotatedShot, average_count, choose
from b23d.stages.geodesic import GeodesicParams, geodesic
from b23d.stages.score import ScoreParams, score
from b23d.stages.scoring.summary import score_table
from tests.made_detections import TOPS, annotated, grid_cube, hills, hills_with_tops, nearest, run
from tests.made_shapes import BOX, of_cloud, of_mesh
from tests.shared_data import shared
from tests.small_runs import make_boxes

FED = """
[feeds]
optimize = "detect"
[stages.normalize]
count = 256
[stages.calibrate]
method = "{method}"
sift = {{min_scale = 0.08, min_contrast = 0}}
"""
DETECTORS = ("iss", "harris", "sift")


def test_farthest_takes_the_average_count_of_the_shots() -> None:
    assert [average_count(counts) for counts in ([4, 5], [4, 4, 5], [0, 0])] == [5, 4, 1]
    shot = annotated(of_mesh(BOX.vertices, BOX.faces), BOX.vertices / 4)
    found = run(shot)
    assert (
        len(found.points) == 8
        and found.method == "farthest count 8"
        and (found.ids == -1).all()
        and found.present.all()
    )
    assert len(run(shot, count=3).points) == 3
    assert (np.diff(found.costs[1:]) >= 0).all(), "farthest first"


@pytest.mark.parametrize("method", ["iss", "harris"])
@pytest.mark.parametrize("seed", range(3))
def test_tops_of_hills_are_found_with_a_scale_calibrated_elsewhere(method: str, seed: int) -> None:
    shot, target = hills_with_tops(seed), hills_with_tops(seed + 10)
    found = run(shot, target, method=method)
    wanted = (TOPS - target[0].center) / target[0].scale
    assert found.method.endswith("count 3") and nearest(found.positions, wanted).max() < 0.05


def test_a_cubes_corners_are_found_by_harris() -> None:
    points, corners = grid_cube()
    found = run(annotated(of_cloud(points), corners), method="harris")
    assert found.method.endswith("count 8") and nearest(found.positions, corners).max() < 0.05


@pytest.mark.parametrize("method", ("farthest", *DETECTORS))
def test_the_same_points_after_a_rotation(method: str) -> None:
    points = hills()
    turned = points @ Rotation.from_euler("xyz", [0.3, 1.1, -0.7]).as_matrix().T
    shapes = [of_cloud(cloud) for cloud in (points, turned)]
    scale = shapes[0].scale / shapes[1].scale  # the bounding box, and with it the unit frame, turns along
    lengths = {"iss_salient_radius": 0.1, "iss_non_max_radius": 0.06, "harris_radius": 0.1, "sift_min_scale": 0.05}
    lengths["harris_separation"] = 0.06
    first = run(annotated(shapes[0], shapes[0].points[:6]), method=method, calibrate=False, **lengths)
    lengths = {name: length * scale for name, length in lengths.items()}
    second = run(annotated(shapes[1], shapes[1].points[:6]), method=method, calibrate=False, **lengths)
    assert len(first.points) and set(first.points) == set(second.points)


def test_calibration_finds_the_scale_and_the_count_that_fit() -> None:
    points = np.stack([np.arange(20) / 10, np.zeros(20), np.zeros(20)], axis=1)
    shot = AnnotatedShot(points, np.abs(points[:, :1] - points[[2, 5, 9], 0]))
    orders = {1.0: [0, 2, 5, 9, 12], 2.0: [2, 5, 9, 0, 12], 4.0: [2, 5, 9, 0, 12]}

    def rank(at: np.ndarray, scale: float) -> np.ndarray:
        return np.array(orders[scale])

    choice = choose([shot], rank, [1.0, 4.0, 2.0], 0.01)
    assert (choice.scale, choice.count, choice.iou) == (2.0, 3, 1.0)
    assert choose([shot], rank, [1.0], 0.01).count == 4 and choose([shot], rank, [1.0], 0.01).iou == 0.75
    assert choose([shot], rank, [1.0], 0.01, count=2).iou == pytest.approx(1 / 4)
    assert choose([shot], lambda at, scale: np.zeros(0, np.int64), [1.0], 0.01).iou == 0


@pytest.mark.parametrize("method", DETECTORS)
def test_calibrating_on_a_shape_serves_it_at_least_as_well(method: str) -> None:
    shot = hills_with_tops()
    shape = shot[0]

    def iou(found: Prediction) -> float:
        hits = (
            np.linalg.norm(found.positions[:, None] - (shot[2].positions - shape.center) / shape.scale, axis=2) <= 0.05
        )
        return float(hits.any(0).sum() / (3 + (~hits.any(1)).sum()))

    calibrated = run(shot, method=method)
    assert (
        iou(calibrated) >= iou(run(shot, method=method, calibrate=False)) - 0.1
    )  # geodesics, not straight lines, are calibrated on
    again = run(shot, method=method)
    np.testing.assert_array_equal(calibrated.points, again.points)


def test_a_plane_has_no_detections_and_that_is_no_error() -> None:
    shape = of_cloud(np.random.default_rng(0).uniform(-0.5, 0.5, (300, 3)) * [1, 1, 0])
    shot = annotated(shape, shape.points[:3])
    assert len(run(shot, method="sift").points) == 0


def test_errors_say_what_is_wrong() -> None:
    shot = annotated(of_mesh(BOX.vertices, BOX.faces), np.zeros((0, 3)))
    with pytest.raises(ValueError, match="shots: expected at least one annotated keypoint"):
        run(shot)
    assert len(run(shot, count=4).points) == 4
    short = GeodesicDistances(distances=shot[1].distances[:5, :5], components=shot[1].components[:5], method="graph")
    with pytest.raises(ValueError, match="re-run geodesic"):
        run(shot, (shot[0], short, shot[2]), count=4)


@pytest.mark.parametrize("method", ("farthest", *DETECTORS))
def test_a_run_is_fed_and_scored_without_names(tmp_path: Path, method: str) -> None:
    path = make_boxes(tmp_path, count=4, extra=FED.format(method=method))
    path.write_text('outputs = ["optimize", "score"]\n' + path.read_text())
    loaded = Run.load(path)
    report = loaded.execute(workers=0)
    assert report.ok, report.failures
    assert len({node.address for node in loaded.plan().nodes.values() if node.stage == "calibrate"}) == 1, (
        "one draw, calibrated once"
    )
    table = score_table("boxes", None, [(s.category, d, s.name, a) for s, d, a in loaded.collect("score")])  # type: ignore[misc]
    assert (
        table.mean.pck.mean[-1] == 0 and table.mean.symmetric_pck.mean[-1] == 0 and table.mean.presence.recall.mean == 0
    )
    assert table.mean.iou.mean == sorted(table.mean.iou.mean)
    if method == "farthest":
        assert table.mean.iou.mean[-1] > 0.4


def test_airplanes_farthest_points_find_most_keypoints() -> None:
    root = shared("keypointnet")
    from b23d.stages.datasets.keypointnet import KeypointNet
    from b23d.stages.normalize import NormalizeParams, normalize

    shape = KeypointNet(root=root, classes=["airplane"], geometry="cloud").shapes()[0]
    leaves = {}
    for name in ("source", "keypoints"):
        leaf = shape.leaves[name]
        leaves[name] = leaf.load(
            {file: path.read_bytes() for file, path in leaf.files.items()}, {**leaf.values, **leaf.context}
        )
    normal = normalize(leaves["source"], NormalizeParams())  # type: ignore[arg-type]
    keypoints = leaves["keypoints"]
    found = run((normal, geodesic(normal, GeodesicParams()), keypoints))  # type: ignore[arg-type]
    places = (keypoints.positions - normal.center) / normal.scale  # type: ignore[attr-defined]
    assert (nearest(found.positions, places) < 0.15).mean() > 0.5


def test_score_takes_detections_without_names_twice_the_same_and_none() -> None:
    shape = of_cloud(hills())
    keypoints = annotated(shape, shape.points[[3, 40]])[2]
    for chosen, expected in (([3, 3, 900], (1, 1, 1)), ([900, 900], (0, 2, 2)), ([], (0, 0, 2))):
        count = len(chosen)
        found = Prediction(
            ids=np.full(count, -1, np.int32), points=np.array(chosen, np.int32),
            positions=shape.points[np.array(chosen, int)],
            present=np.ones(count, bool), costs=np.zeros(count, np.float32), objective=0, method="by hand",
        )  # fmt: skip
        scored = score(shape, found, keypoints, [keypoints], ScoreParams(thresholds=(0.001,)))
        assert (scored.true_positives[0], scored.false_positives[0], scored.false_negatives[0]) == expected
        assert scored.labelled[0] == scored.symmetric[0] == scored.common == 0 and scored.matched[0] == expected[0]
