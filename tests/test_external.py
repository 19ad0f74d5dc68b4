"""Files of other systems: every format, what is wrong with them, and whole runs scored from them."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from b23d.pipeline.run import Run
from b23d.schemas.external import External
from b23d.schemas.features import PointFeatures
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.predictions import Prediction
from b23d.stages.datasets.folder import Folder
from b23d.stages.datasets.keypointnet import KeypointNet
from b23d.stages.import_features import ImportFeaturesParams, import_features
from b23d.stages.import_predictions import ImportPredictionsParams, import_predictions
from b23d.stages.scoring.summary import score_table
from tests.made_params import placed
from tests.made_shapes import of_cloud
from tests.small_runs import FAST, make_boxes

CLOUD = np.random.default_rng(0).uniform(-3, 5, (60, 3))
SHAPE = of_cloud(CLOUD)
NO_KEYPOINTS = Keypoints(ids=np.zeros(0, np.int32), positions=np.zeros((0, 3)), point_indices=np.zeros(0, np.int32))


def npz(**arrays: Any) -> bytes:
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


def npy(array: Any) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, np.asarray(array))
    return buffer.getvalue()


def predictions(data: bytes, suffix: str = ".npz", shots: list[Keypoints] | None = None, **params: Any) -> Prediction:
    return import_predictions(
        SHAPE,
        External(shape="chair/one", suffix=suffix, data=data),
        shots or [],
        placed(ImportPredictionsParams, **params),
    )


def features(data: bytes, suffix: str = ".npz", **params: Any) -> PointFeatures:
    return import_features(SHAPE, External(shape="chair/one", suffix=suffix, data=data), ImportFeaturesParams(**params))


@pytest.mark.parametrize(
    ("data", "suffix"),
    [
        (npz(points=CLOUD[[4, 7, 4]]), ".npz"),
        (npz(indices=np.array([4, 7, 4])), ".npz"),
        (npy(CLOUD[[4, 7, 4]]), ".npy"),
        (npy([4, 7, 4]), ".npy"),
        (b"# x y z\n" + "\n".join("{} {} {}".format(*p) for p in CLOUD[[4, 7, 4]]).encode(), ".txt"),
        ("\n".join("{},{},{}".format(*p) for p in CLOUD[[4, 7, 4]]).encode(), ".csv"),
    ],
)
def test_generic_points_and_indices_are_the_candidates_meant(data: bytes, suffix: str) -> None:
    found = predictions(data, suffix)
    assert found.points.tolist() == [4, 7, 4] and found.ids.tolist() == [-1, -1, -1] and found.present.all()
    np.testing.assert_array_equal(found.positions, SHAPE.points[[4, 7, 4]])


def test_generic_names_and_scores_and_text_columns() -> None:
    found = predictions(npz(points=CLOUD[:3], ids=np.array([5, 0, 2]), scores=np.array([0.1, 0.9, 0.5])))
    assert found.points.tolist() == [1, 2, 0] and found.ids.tolist() == [0, 2, 5]
    np.testing.assert_allclose(found.costs, [-0.9, -0.5, -0.1], rtol=1e-6)
    rows = "\n".join(
        "{} {} {} {} {}".format(*p, s, i) for p, s, i in zip(CLOUD[:3], (0.1, 0.9, 0.5), (5, 0, 2), strict=True)
    )
    text = predictions(rows.encode(), ".txt")
    assert text.points.tolist() == [1, 2, 0] and text.ids.tolist() == [0, 2, 5]


def test_the_unit_frame_is_taken_where_it_is_said() -> None:
    assert predictions(npz(points=SHAPE.points[[8, 9]]), frame="unit").points.tolist() == [8, 9]


def test_usip_is_raw_float32_surest_first() -> None:
    data = CLOUD[[3, 1, 2]].astype("<f4").tobytes()
    assert predictions(data, ".bin", format="usip").points.tolist() == [3, 1, 2]
    assert predictions(data, ".bin", format="usip", keep=2).points.tolist() == [3, 1]


def test_d3feat_is_every_point_with_a_score() -> None:
    order = np.random.default_rng(1).permutation(60)
    scores = np.sort(np.random.default_rng(2).random(60)).astype(np.float32)[:, None]
    data = npz(keypts=CLOUD[order].astype(np.float32), features=np.zeros((60, 32), np.float32), scores=scores)
    shots = [NO_KEYPOINTS.model_copy(update={"ids": np.arange(k, dtype=np.int32)}) for k in (4, 5)]
    assert predictions(data, format="d3feat", keep="average", shots=shots).points.tolist() == order[::-1][:5].tolist()
    assert len(predictions(data, format="d3feat", min_score=float(scores[40, 0])).points) == 19


def test_ukpgan_is_a_probability_a_point_suppressed_and_cut_as_its_own_evaluation() -> None:
    line = np.stack([np.arange(60) * 0.04, np.zeros(60), np.zeros(60)], axis=1)
    shape = of_cloud(line)
    prob = np.full(60, 0.2)
    prob[[10, 11, 14, 40]] = [0.9, 0.8, 0.7, 0.45]
    for data, suffix in ((npy(prob), ".npy"), (npz(prob=prob[:, None]), ".npz")):
        file = External(shape="chair/one", suffix=suffix, data=data)
        assert import_predictions(shape, file, [], ImportPredictionsParams(format="ukpgan")).points.tolist() == [10, 14]
        wide = ImportPredictionsParams(format="ukpgan", nms_radius=0, min_score=0.4)
        assert import_predictions(shape, file, [], wide).points.tolist() == [10, 11, 14, 40]


def test_fskd_has_names() -> None:
    assert predictions(npz(indices=np.array([9, 2]), ids=np.array([3, 1])), format="fskd").ids.tolist() == [3, 1]
    with pytest.raises(ValueError, match="chair/one: expected ids, got indices"):
        predictions(npz(indices=np.array([9, 2])), format="fskd")


def test_sift3d_rows_are_voxels_of_an_octave() -> None:
    spacing, origin = 0.25, (-3.0, -3.0, -3.0)
    voxels = (CLOUD[:2] - origin) / spacing
    rows = [[*(voxels[0] / 2), 1, 1.6, *np.eye(3).ravel()], [*(voxels[1] * 2), -1, 1.6, *np.eye(3).ravel()]]
    for table in (rows, [[0.5, *rows[0]], [0.7, *rows[1]]]):
        data = "\n".join(",".join(map(str, row)) for row in table).encode()
        found = predictions(data, ".csv", format="sift3d-csv", spacing=spacing, origin=origin)
        assert found.points.tolist() == ([0, 1] if len(table[0]) == 14 else [1, 0])


@pytest.mark.parametrize(
    ("data", "suffix", "params", "message"),
    [
        (npz(points=CLOUD[:3] + 40), ".npz", {}, "chair/one: expected points on the shape.*frame"),
        (npz(points=CLOUD[:3] * np.nan), ".npz", {}, "finite points"),
        (npz(indices=np.array([1, 60])), ".npz", {}, "expected indices below 60, got 1 … 60"),
        (npz(indices=np.array([1.5])), ".npz", {}, "whole numbers as indices"),
        (npz(points=CLOUD[:3], indices=np.arange(3)), ".npz", {}, "either points or indices, got points, indices"),
        (npz(keypoints=CLOUD[:3]), ".npz", {}, "got keypoints; set another format"),
        (npz(points=CLOUD[:3, :2]), ".npz", {}, r"points of \(k, 3\) numbers, got float64 \(3, 2\)"),
        (npz(points=CLOUD[:3], ids=np.arange(2)), ".npz", {}, "expected ids of 3 keypoints, got 2"),
        (npz(points=CLOUD[:3], scores=np.full(3, np.nan)), ".npz", {}, "expected scores, got NaN"),
        (npz(points=CLOUD[:3]), ".npz", {"min_score": 0.5}, "expected scores in a generic file, got none"),
        (npz(points=CLOUD[:3])[:60], ".npz", {}, "chair/one: expected a .npz file of numbers"),
        (b"1 2 x", ".txt", {}, "chair/one: expected a .txt file of numbers"),
        (b"1 2", ".txt", {}, r"expected rows of x y z \[score \[id\]\]"),
        (npy(np.array([{}], dtype=object)), ".npy", {}, "expected a .npy file of numbers"),
        (b"12345", ".bin", {"format": "usip"}, "12 bytes a keypoint, got .bin of 5"),
        (b"12345", ".bin", {}, "expected .npz, .npy, .txt or .csv, got .bin"),
        (npz(features=CLOUD), ".npz", {"format": "d3feat"}, "expected keypts and scores, got features"),
        (npy(np.zeros(7)), ".npy", {"format": "ukpgan"}, "probability of each of 60 candidates, got 7"),
        (b"1 2 3", ".csv", {"format": "sift3d-csv"}, "rows of 14 numbers"),
    ],
)
def test_a_wrong_file_is_named_with_what_is_wrong(
    data: bytes, suffix: str, params: dict[str, Any], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        predictions(data, suffix, **params)


def test_features_by_row_or_by_nearest_point() -> None:
    values = np.random.default_rng(3).normal(size=(60, 4)).astype(np.float32)
    rows = features(npz(features=values))
    np.testing.assert_array_equal(rows.features, values.astype(np.float16))
    assert rows.observed.all() and rows.descriptor == "imported generic"
    order = np.random.default_rng(4).permutation(60)[:50]
    for data, params in (
        (npz(features=values[order], points=CLOUD[order]), {}),
        (npz(features=values[order], keypts=CLOUD[order], scores=np.zeros((50, 1))), {"format": "d3feat"}),
    ):
        found = features(data, reach=0.01, **params)
        np.testing.assert_array_equal(found.features[order], values[order].astype(np.float16))
        assert found.observed.sum() == 50 and found.observed[order].all()


def test_wrong_features_are_named() -> None:
    for data, message in (
        (npz(features=CLOUD[:9]), "features of 60 candidates, got 9"),
        (npz(features=CLOUD * 1e6), "within ±65504"),
        (npz(features=CLOUD, points=CLOUD[:9]), "expected points of 60 features, got 9"),
        (npz(features=CLOUD, points=CLOUD + 50), "expected points on the shape"),
        (npz(other=CLOUD), "expected features of"),
    ):
        with pytest.raises(ValueError, match=f"chair/one: .*{message}"):
            features(data)


def test_data_sets_list_the_files_once_and_name_what_is_missing(tmp_path: Path) -> None:
    make_boxes(tmp_path, count=3)
    out = tmp_path / "out"
    with pytest.raises(FileNotFoundError, match="external_predictions: expected a folder"):
        Folder(root=tmp_path / "shapes", external_predictions=out).shapes()
    (out / "box").mkdir(parents=True)
    with pytest.raises(FileNotFoundError, match=r"expected files of \.npz"):
        Folder(root=tmp_path / "shapes", external_predictions=out).shapes()
    (out / "b0.npy").write_bytes(npy(np.zeros((1, 3))))
    (out / "box" / "b0.npz").write_bytes(npz(points=np.zeros((1, 3))))
    (out / "b1.txt").write_text("0 0 0")
    shapes = Folder(root=tmp_path / "shapes", external_predictions=out).shapes()
    assert [
        list(s.leaves["external_predictions"].files) if "external_predictions" in s.leaves else [] for s in shapes
    ] == [["external.npz"], ["external.txt"], []]
    assert all("external_features" not in s.leaves for s in shapes)
    (out / "b1.csv").write_text("0,0,0")
    shapes = Folder(root=tmp_path / "shapes", external_predictions=out).shapes()
    with pytest.raises(ValueError, match=r"box/b1: .*expected one file for b1, got b1\.csv and b1\.txt"):
        shapes[1].leaves["external_predictions"].read()
    assert shapes[1].error is None, "it loses nothing else"


def test_keypointnet_has_them_too(tmp_path: Path) -> None:
    (tmp_path / "annotations").mkdir()
    (tmp_path / "pcds" / "01").mkdir(parents=True)
    (tmp_path / "pcds" / "01" / "m.pcd").write_text("")
    (tmp_path / "annotations" / "mug.json").write_text(
        json.dumps([{"class_id": "01", "model_id": "m", "keypoints": []}])
    )
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "m.bin").write_bytes(b"")
    (shape,) = KeypointNet(root=tmp_path, external_predictions=tmp_path / "out").shapes()
    assert list(shape.leaves["external_predictions"].files) == ["external.bin"]


def corners(folder: Path) -> dict[str, np.ndarray]:
    entries = json.loads((folder / "shapes" / "keypoints.json").read_text())
    return {entry["model_id"]: np.array([k["xyz"] for k in entry["keypoints"]]) for entry in entries}


def test_a_run_scores_imported_predictions(tmp_path: Path) -> None:
    head = 'outputs = ["optimize", "score"]\n'
    path = make_boxes(
        tmp_path, count=4, extra='[feeds]\noptimize = "import_predictions"\n[stages.normalize]\ncount = 256\n'
    )
    path.write_text(head + path.read_text().replace('root = "shapes"', 'root = "shapes"\nexternal_predictions = "out"'))
    (tmp_path / "out").mkdir()
    for name, places in corners(tmp_path).items():
        (tmp_path / "out" / f"{name}.npz").write_bytes(npz(points=places, ids=np.arange(8)))
    run = Run.load(path)
    report = run.execute(workers=0)
    assert report.ok, report.failures
    table = score_table("boxes", None, [(s.category, d, s.name, a) for s, d, a in run.collect("score")])  # type: ignore[misc]
    mean = table.mean
    assert mean.targets == 2 and mean.pck.mean[-1] == mean.iou.mean[-1] == mean.presence.precision.mean == 1
    assert {outcome.stage for outcome in report.done} == {"normalize", "annotation", "import_predictions", "score"}

    target = next(run.collect("score"))[0].id
    (tmp_path / "out" / f"{target}.npz").write_bytes(npz(points=corners(tmp_path)[target][:4]))
    again = Run.load(path)
    redone = again.execute(workers=0)
    assert redone.ok and sorted(o.stage for o in redone.done) == ["import_predictions", "score"], (
        "only what the changed file feeds"
    )
    (tmp_path / "out").rename(tmp_path / "elsewhere")
    moved = Run.load(path, [f'dataset.external_predictions="{tmp_path / "elsewhere"}"'])
    assert moved.plan().to_run() == [], "where the files are does not matter"


@pytest.mark.parametrize("argument", ["backproject", "reweight"])
def test_a_run_finds_keypoints_by_imported_features(tmp_path: Path, argument: str) -> None:
    """Features that are the place on the box, at other points of its surface than the candidates: its corners are
    found."""
    extra = f'[feeds]\n{argument} = "import_features"\n[stages.import_features]\nreach = 1\n{FAST}'
    path = make_boxes(tmp_path, count=4, extra=extra)
    lines = path.read_text().replace('root = "shapes"', 'root = "shapes"\nexternal_features = "out"')
    path.write_text('outputs = ["optimize", "score"]\n' + lines)
    (tmp_path / "out" / "box").mkdir(parents=True)
    rng = np.random.default_rng(0)
    for name, places in corners(tmp_path).items():
        on_unit = rng.uniform(-1, 1, (1500, 3))
        on_unit[np.arange(1500), rng.integers(0, 3, 1500)] = rng.choice([-1, 1], 1500)
        data = npz(features=on_unit.astype(np.float32), points=on_unit * np.abs(places).max(axis=0))
        (tmp_path / "out" / "box" / f"{name}.npz").write_bytes(data)
    run = Run.load(path)
    report = run.execute(workers=0)
    assert report.ok, report.failures
    assert {outcome.stage for outcome in report.done}.isdisjoint({"render", "extract"})
    table = score_table("boxes", None, [(s.category, d, s.name, a) for s, d, a in run.collect("score")])  # type: ignore[misc]
    assert table.mean.pck.mean[-1] > 0.7
