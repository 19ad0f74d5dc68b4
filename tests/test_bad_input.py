"""Bad input: each gets an error that names the shape and what to do, is quarantined, and stops nothing else."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from b23d.pipeline.cli import app
from b23d.pipeline.errors import RunFileError
from b23d.pipeline.run import Run
from tests.small_runs import make_boxes

GEOMETRY = ['outputs=["geodesic"]']  # no need to render for these


BAD: dict[str, tuple[str, Callable[[], str], str]] = {
    "empty file": ("bad.obj", lambda: "", "empty|no "),
    "unreadable bytes": ("bad.ply", lambda: "this is no ply", "bad"),
    "no faces": ("bad.obj", lambda: "v 0 0 0\n", "bad"),
    "nan vertices": ("bad.obj", lambda: "v nan 0 0\nv nan 1 0\nv 0 0 1\nv 0 1 1\nf 1 2 3\nf 2 3 4\n", "finite"),
    "face index out of range": ("bad.obj", lambda: "v 0 0 0\nv 0 1 0\nv 1 0 0\nf 1 2 9\n", "range|index|below|vert"),
    "all degenerate": ("bad.obj", lambda: "v 0 0 0\nv 0 1 0\nv 1 0 0\nf 1 1 2\n", "degenerate|face"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_shape_is_named_and_the_rest_finishes(tmp_path: Path, case: str) -> None:
    name, text, message = BAD[case]
    path = make_boxes(tmp_path, 3)
    (tmp_path / "shapes" / "box" / name).write_text(text())
    report = Run.load(path, GEOMETRY).execute(workers=0)
    assert [failure.shape for failure in report.failures] == ["box/bad"], case
    assert re.search(message, report.failures[0].error), report.failures[0].error
    assert "box/bad" in report.failures[0].error or "bad" in report.failures[0].error
    assert len([o for o in report.done if o.stage == "geodesic"]) == 3
    again = Run.load(path, GEOMETRY).execute(workers=0)
    assert again.done == [] and len(again.failures) == 1, "only the bad one is tried again"


def test_the_command_line_says_it_and_exits_1(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 3)
    (tmp_path / "shapes" / "box" / "bad.obj").write_text("")
    result = CliRunner().invoke(app, ["run", str(path), "--workers", "0", "--set", GEOMETRY[0]])
    assert result.exit_code == 1 and "box/bad" in result.output and "1 failed" in result.output


def test_a_keypoint_index_out_of_range_blocks_that_shape_only(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 4)
    for i in range(4):  # as clouds: there the index counts
        mesh = tmp_path / "shapes" / "box" / f"b{i}.ply"
        np.savetxt(mesh.with_suffix(".xyz"), trimesh.load(mesh, process=False).sample(300, seed=i))
        mesh.unlink()
    file = tmp_path / "shapes" / "keypoints.json"
    entries = json.loads(file.read_text())
    shots = {shot.id for draw in Run.load(path).plan().draws for shot in draw.shots}
    victim = next(entry for entry in entries if entry["model_id"] not in shots)
    victim["keypoints"][0]["pcd_info"] = {"point_index": 10**6}
    file.write_text(json.dumps(entries))
    report = Run.load(path).execute(workers=0)
    assert {f.shape for f in report.failures} == {f"box/{victim['model_id']}"}
    assert "1000000" in report.failures[0].error
    assert any(o.stage == "score" for o in report.done)


def test_an_annotation_of_a_missing_shape(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 3)
    (tmp_path / "shapes" / "box" / "b1.ply").unlink()
    report = Run.load(path, GEOMETRY).execute(workers=0)
    assert not report.failures, "geometry needs no annotation"
    assert len([o for o in report.done if o.stage == "geodesic"]) == 2
    (failure,) = Run.load(path, ['outputs=["geodesic", "annotation"]']).execute(workers=0).failures
    assert "/b1: expected a mesh or cloud b1.* below" in failure.error


def test_fewer_shapes_than_shots(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 2)
    report = Run.load(path, ["shots.count=3", 'outputs=["geodesic", "optimize"]']).execute(workers=0)
    assert "class box: expected 3 annotated shapes as shots, got 2" in report.failures[0].error
    assert len([o for o in report.done if o.stage == "geodesic"]) == 2


def test_shots_without_common_keypoints(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 3)
    file = tmp_path / "shapes" / "keypoints.json"
    entries = json.loads(file.read_text())
    for i, entry in enumerate(entries):
        for keypoint in entry["keypoints"]:
            keypoint["semantic_id"] += 100 * i
    file.write_text(json.dumps(entries))
    report = Run.load(path).execute(workers=0)
    assert any("shots annotated with the same ids" in failure.error for failure in report.failures), report.failures


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ('stages.extract.encoder="dinov2-smal"', "dinov2-small"),
        ('stages.extract.weights="nowhere"', "nowhere"),
        ('stages.extract.weights_sha256="00"', "00"),
        ("stages.render.ring=2", "did you mean 'rings'"),
    ],
)
def test_bad_parameters_stop_the_run_before_it_starts(tmp_path: Path, override: str, message: str) -> None:
    path = make_boxes(tmp_path, 3)
    with pytest.raises((RunFileError, ValueError, FileNotFoundError), match=message):
        Run.load(path, [override]).execute(workers=0)
    assert not (tmp_path / "store" / "normalize").exists()


def test_a_missing_data_set_and_a_store_that_cannot_be_written(tmp_path: Path) -> None:
    path = make_boxes(tmp_path, 3)
    with pytest.raises((FileNotFoundError, RunFileError), match="nowhere"):
        Run.load(path, ["dataset.root=nowhere"]).plan()
    (tmp_path / "file").write_text("")
    with pytest.raises(PermissionError, match="--store"):
        Run.load(path, GEOMETRY, store=str(tmp_path / "file" / "x")).execute(workers=0)
