"""detect: farthest points, ISS, HARRIS-3D, SIFT, and their calibration on the shots."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from b23d.pipeline.run import Run
from b23d.schemas.features import GeodesicDistances
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.predictions import Prediction
from b23d.schemas.shape import NormalizedShape
from b23d.stages.calibrate import CalibrateParams, calibrate
from b23d.stages.detect import DetectParams, detect
from b23d.stages.detectors.calibration import AnnotatedShot, average_count, choose
from b23d.stages.detectors.farthest import farthest
from b23d.stages.detectors.harris3d import harris3d
from b23d.stages.detectors.iss import iss
from b23d.stages.detectors.neighbourhoods import ball_sums, scatter_matrices, strongest
from b23d.stages.detectors.sift3d import extrema, sift3d, surface_variation
from b23d.stages.geodesic import GeodesicParams, geodesic
from b23d.stages.score import ScoreParams, score
from b23d.stages.scoring.summary import score_table
from tests.made_params import placed
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
Shot = tuple[NormalizedShape, GeodesicDistances, Keypoints]


def annotated(shape: NormalizedShape, places: Any) -> Shot:
    """A shape with keypoints at places of the unit frame."""
    places = np.asarray(places, float)
    source = places * shape.scale + shape.center
    keypoints = Keypoints(
        ids=np.arange(len(places), dtype=np.int32), positions=source, point_indices=np.full(len(places), -1, np.int32)
    )
    return shape, geodesic(shape, GeodesicParams()), keypoints


def run(shot: Shot, target: Shot | None = None, **params: Any) -> Prediction:
    shape, distances, _ = target or shot
    detector = calibrate([shot[0]], [shot[1]], [shot[2]], placed(CalibrateParams, **params))
    return detect(shape, distances, detector, DetectParams())


def grid_cube(side: int = 13) -> tuple[np.ndarray, np.ndarray]:
    """A cube's surface as a cloud, not on a lattice, and its corners; unit frame."""
    line = np.linspace(-0.5, 0.5, side)
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    points = grid[np.abs(grid).max(axis=1) == 0.5]
    free = np.abs(points) < 0.5
    return points + np.random.default_rng(0).uniform(-0.02, 0.02, points.shape) * free, points[(~free).all(axis=1)]


def nearest(found: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    return np.linalg.norm(found[:, None] - wanted[None], axis=2).min(axis=0)


CENTRES, HEIGHTS = np.array([[-0.25, -0.2], [0.2, 0.25], [0.25, -0.25]]), np.array([0.06, 0.07, 0.08])
TOPS = np.column_stack([CENTRES, HEIGHTS])


def hills(seed: int = 0) -> np.ndarray:
    """A square with three oblong hills, as a cloud with their tops at its end."""
    places = np.concatenate([np.random.default_rng(seed).uniform(-0.5, 0.5, (1200, 2)), CENTRES])
    x, y = np.moveaxis(places[:, None] - CENTRES, 2, 0)
    return np.column_stack([places, np.exp(-(x**2) / (2 * 0.07**2) - y**2 / (2 * 0.035**2)) @ HEIGHTS])


def hills_with_tops(seed: int = 0) -> Shot:
    shape = of_cloud(hills(seed))
    return annotated(shape, (TOPS - shape.center) / shape.scale)


def test_farthest_points_of_a_segment_are_its_ends_then_its_middle() -> None:
    places = np.linspace(0, 1, 101)
    chosen, gaps = farthest(np.abs(places[:, None] - places).astype(np.float16), 5)
    assert set(chosen[:2]) == {0, 100} and chosen[2] == 50 and set(places[chosen[3:]]) == {0.25, 0.75}
    np.testing.assert_allclose(gaps, [0.5, 1, 0.5, 0.25, 0.25], atol=1e-3)


def test_farthest_points_are_distinct_even_where_all_coincide_and_end_with_the_cloud() -> None:
    assert sorted(farthest(np.zeros((4, 4)), 9)[0]) == [0, 1, 2, 3]
    apart = np.full((4, 4), np.inf)
    apart[:2, :2] = apart[2:, 2:] = [[0, 1], [1, 0]]
    assert len(farthest(apart, 2)[0]) == 2


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


def test_strongest_keeps_what_nothing_near_exceeds() -> None:
    points = np.stack([np.arange(6) / 10, np.zeros(6), np.zeros(6)], axis=1)
    response = np.array([1, 2, 1, 3, 3, np.nan])
    assert strongest(points, response, 0.11).tolist() == [3, 1]
    assert strongest(points, response, 0.05).tolist() == [3, 4, 1, 0, 2]
    assert not len(strongest(points, np.zeros(6), 1.0))


def test_ball_sums_and_scatters_are_what_they_say() -> None:
    rng = np.random.default_rng(0)
    points, weights = rng.normal(size=(700, 3)), rng.uniform(1, 2, 700)
    near = np.linalg.norm(points[:, None] - points, axis=2) <= 0.5
    np.testing.assert_allclose(ball_sums(points, 0.5, weights[:, None])[:, 0], near @ weights)
    about, mean = scatter_matrices(points, 0.5, weights)
    offsets = points[near[3]] - points[3]
    share = weights[near[3]] / weights[near[3]].sum()
    np.testing.assert_allclose(about[3], (offsets * share[:, None]).T @ offsets, atol=1e-12)
    np.testing.assert_allclose(mean[3], share @ offsets, atol=1e-12)


def paraboloid(a: float, b: float, radius: float = 0.1) -> np.ndarray:
    line = np.linspace(-1, 1, 21)
    x, y = (values.ravel() for values in np.meshgrid(line, line))
    return np.stack([x, y, a * x * x / 2 + b * y * y / 2], axis=1)[np.hypot(x, y) <= 1] * radius


@pytest.mark.parametrize(("a", "b"), [(0.2, 0.2), (0.2, -0.2), (0.3, 0.0), (0.0, 0.0)])
def test_harris_is_the_closed_form_on_a_quadratic_patch(a: float, b: float) -> None:
    points = paraboloid(a, b)
    apex = int(np.linalg.norm(points, axis=1).argmin())
    expected = 4 * a * a * b * b - 0.04 * (2 * a * a + 2 * b * b) ** 2
    assert harris3d(points, 0.11, 0.04)[apex] == pytest.approx(expected * 1.1**4, abs=1e-4 + 0.15 * abs(expected))


def test_planes_have_no_keypoints_anywhere() -> None:
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (600, 3)) * [1, 1, 0]
    assert np.abs(iss(points, 0.1, 1, 1, 5)).max() < 1e-12
    assert harris3d(points, 0.1, 0.04).max() < 1e-12
    assert surface_variation(points, 0.1).max() < 1e-12 and not sift3d(points, 0.03, 2, 3, 1e-6).any()


def test_iss_on_a_cube_has_the_values_of_the_integrals() -> None:
    """About a corner of three quarter discs, λ3 / r² = 1/6 - 1/(6π); about an edge of two half discs 1/8, and in both
    λ2 = λ3."""
    points, corners = grid_cube(25)
    places = np.concatenate([corners[:1], [[0.5, 0.5, 0], [0.5, 0, 0]]])
    at = np.linalg.norm(points[:, None] - places, axis=2).argmin(axis=0)
    np.testing.assert_allclose(iss(points, 0.3, 1.01, 1.01, 5)[at], [1 / 6 - 1 / (6 * np.pi), 1 / 8, 0], atol=0.02)
    assert (iss(points, 0.3, 0.9, 0.9, 5)[at] == 0).all(), (
        "axes that are not distinct: a cube's own corners are none of ISS's keypoints"
    )


def test_iss_needs_neighbours_and_knows_no_unit() -> None:
    points = hills()
    assert not iss(points, 0.1, 0.975, 0.975, 10_000).any()
    assert (iss(points, 0.1, 0.8, 0.8, 5) > 0).sum() < (iss(points, 0.1, 1, 1, 5) > 0).sum()
    np.testing.assert_allclose(iss(points * 2, 0.2, 1, 1, 5), iss(points, 0.1, 1, 1, 5), atol=1e-9)


def test_sift_finds_a_spot_at_its_own_scale() -> None:
    """A Gaussian spot of deviation s, blurred by σ, is s² / (s² + σ²) high: it falls fastest, in log σ, at σ = s."""
    line = np.linspace(-0.5, 0.5, 51)
    points = np.stack([*(axis.ravel() for axis in np.meshgrid(line, line)), np.zeros(51 * 51)], axis=1)
    sigmas = 0.025 * 2 ** (np.arange(11) / 3)
    for spot in (0.05, 0.08):
        strength = extrema(points, np.exp(-(points**2).sum(axis=1) / (2 * spot**2)), sigmas)
        level, point = np.unravel_index(strength.argmax(), strength.shape)
        assert np.linalg.norm(points[point]) < 1e-9
        assert abs(np.log2(np.sqrt(sigmas[level + 1] * sigmas[level + 2]) / spot)) < 0.5 / 3 + 1e-6
        assert strength.max() == pytest.approx(
            abs(np.diff(spot**2 / (spot**2 + sigmas[level + 1 : level + 3] ** 2))[0]), rel=0.03
        )


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
