"""Whole runs on small real input, through the command line: what re-runs, what it prints, what it keeps."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from b23d.pipeline.cli import app, plug_in
from b23d.pipeline.run import Run
from b23d.schemas.predictions import Prediction
from tests.shared_data import shared
from tests.small_runs import FAST, make_boxes

plug_in()
PROCEDURAL = """
name = "small"
[dataset]
kind = "procedural"
classes = ["chair", "mug"]
count = 3
[shots]
count = 2
draws = [0]
[store]
root = "{store}"
"""


def b23d(*arguments: str, code: int = 0) -> str:
    result = CliRunner().invoke(app, [*arguments], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result.output


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run on procedural chairs and mugs."""
    folder = tmp_path_factory.mktemp("small")
    path = folder / "small.toml"
    path.write_text(PROCEDURAL.format(store=folder / "store") + FAST)
    output = b23d("run", str(path), "--workers", "2")
    assert "AUC" in output
    return path


def test_a_second_run_does_nothing_and_says_so(small: Path) -> None:
    assert "nothing to do: small is complete" in b23d("run", str(small))
    stages = json.loads(b23d("plan", str(small), "--json", "--exit-code"))["stages"]
    assert all(row["run"] == row["blocked"] == 0 and row["cached"] > 0 for row in stages.values())


def test_an_option_of_optimize_re_runs_optimize_and_score_only_and_sigma_from_the_smoothing_on(small: Path) -> None:
    def to_run(override: str) -> set[str]:
        stages = json.loads(b23d("plan", str(small), "--json", "--set", override))["stages"]
        return {name for name, row in stages.items() if row["run"]}

    assert to_run("stages.optimize.method=nearest") == {"optimize", "score"}, "the shots' model serves every method"
    assert to_run("stages.learn.ridge=7") == {"learn", "optimize", "score"}
    assert to_run("stages.reweight.sigma=0.07") == {"reweight", "learn", "optimize", "score"}
    assert to_run("shots.draws=[9]") <= {"learn", "optimize", "score"}
    assert to_run("stages.render.rings.count=2") == {
        "render",
        "extract",
        "backproject",
        "reweight",
        "learn",
        "optimize",
        "score",
    }


def test_plan_says_why_a_class_has_no_draw(small: Path) -> None:
    words = "class chair: expected 5 annotated shapes as shots, got 3; annotate more, or lower shots.count"
    assert words in b23d("plan", str(small), "--set", "shots.count=5")
    assert any(
        words in problem
        for problem in json.loads(b23d("plan", str(small), "--json", "--set", "shots.count=5"))["problems"]
    )


def test_scores_json_has_the_documented_keys(small: Path) -> None:
    scores = json.loads(b23d("scores", str(small), "--json"))
    assert scores["run"] == "small" and set(scores["classes"]) == {"chair", "mug"}
    for row in (*scores["classes"].values(), scores["mean"]):
        assert {"targets", "thresholds", "iou", "auc", "pck", "ceiling"} <= set(row)
        assert len(row["thresholds"]) == len(row["iou"]["mean"]) == len(row["iou"]["sd"]) == 11
        assert np.all(np.diff(row["iou"]["mean"]) >= -1e-12), "IoU grows with the threshold"
    assert json.loads((small.parent / "small" / "scores.json").read_text()) == scores


def test_every_stage_can_be_shown_and_exported(small: Path, tmp_path: Path) -> None:
    run = Run.load(small)
    target = run.plan().draws[0].targets[0].name
    for stage in run.config.stages:
        assert "provenance" in b23d("show", str(small), target, stage)
        b23d("show", str(small), target, stage, "--export", str(tmp_path / f"{stage}.npz"))
        assert np.load(tmp_path / f"{stage}.npz").files


def test_explain_says_what_changed(small: Path) -> None:
    target = Run.load(small).plan().draws[0].targets[0].name
    assert "stages.reweight.sigma: " in b23d(
        "explain", str(small), target, "optimize", "--set", "stages.reweight.sigma=0.07"
    )


def test_diff_puts_two_runs_side_by_side(small: Path) -> None:
    b23d("run", str(small), "--set", "stages.optimize.method=nearest", "--workers", "0")
    output = b23d("diff", str(small), str(small), "--set2", "stages.optimize.method=nearest")
    assert "stages.optimize.method" in output and "nearest" in output and "moved" in output
    assert "±" not in output, "one draw tells no spread"


def test_transient_stages_give_the_same_predictions(small: Path, tmp_path: Path) -> None:
    override = 'store.transient=["render", "extract"]'
    b23d(
        "run",
        str(small),
        "--set",
        override,
        "--set",
        'dataset.classes=["mug"]',
        "--workers",
        "0",
        "--store",
        str(tmp_path),
    )
    assert not (tmp_path / "extract").exists()
    for shape, draw, artifact in Run.load(small, ['dataset.classes=["mug"]'], str(tmp_path)).collect("optimize"):
        kept = Run.load(small).artifact(shape.name, "optimize", draw)
        assert isinstance(artifact, Prediction) and isinstance(kept, Prediction)
        np.testing.assert_array_equal(artifact.points, kept.points)


def test_boxes_corners_are_found(tmp_path: Path) -> None:
    finer = FAST.replace("rings.count = 1", "rings.count = 3").replace("resolution = 64", "resolution = 128")
    path = make_boxes(tmp_path, extra=finer)
    b23d("run", str(path), "--workers", "0")
    scores = json.loads(b23d("scores", str(path), "--json"))
    assert scores["mean"]["iou"]["mean"][10] > 0.5


def test_keypointnet_clouds(tmp_path: Path) -> None:
    root = shared("keypointnet")
    path = tmp_path / "k.toml"
    path.write_text(
        f'name = "k"\n[dataset]\nkind = "keypointnet"\nroot = "{root}"\nclasses = ["airplane"]\n[shots]\ndraws = [0]\n'
        f'[store]\nroot = "{tmp_path / "store"}"\n' + FAST
    )
    b23d("run", str(path), "--workers", "2", "--limit", "2")
    scores = json.loads(b23d("scores", str(path), "--json"))
    assert scores["classes"]["airplane"]["targets"] >= 1
    assert len(scores["classes"]["airplane"]["annotation_files"]) == 1
