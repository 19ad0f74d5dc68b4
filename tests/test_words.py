"""Verbs that look and list: what there is, what can be set, how to be told in JSON."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path

import pytest

from b23d.pipeline.errors import SelectionError
from b23d.pipeline.inspection.listing import list_artifacts, list_shapes
from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.run import Run
from b23d.pipeline.stage import load_stages
from b23d.stages.encoders.names import known_name
from b23d.stages.workbench.results.scores import run_scores
from tests.report_runs import mixed
from tests.small_runs import b23d, make_boxes
from tests.toy import make_toy


def test_list_has_every_shape_with_its_state() -> None:
    run = mixed()
    rows = {row.shape: row for row in list_shapes(run)}
    assert set(rows) == {shape.name for shape in run.shapes}
    assert rows["box/broken"].state == "failed" and "broken" in rows["box/broken"].error
    assert rows["box/b0"].state == "done" and rows["box/b0"].annotated and rows["box/b0"].bytes > 1000
    shots = {(shot.name, draw.seed) for draw in run.plan().draws for shot in draw.shots}
    assert {(name, seed) for name, row in rows.items() for seed in row.shot} == shots


def test_list_of_a_stage_has_its_artifacts() -> None:
    run = mixed()
    rows = list_artifacts(run, "optimize")
    assert {row.address for row in rows} == {n.address for n in run.plan().nodes.values() if n.stage == "optimize"}
    assert {row.shape: row.state for row in rows if row.state != "done"} == {"box/broken": "blocked"}
    assert all(row.draws and (row.bytes > 0) == (row.state == "done") for row in rows)
    with pytest.raises(SelectionError, match=r"stage: expected one of normalize, .* got 'optimise'"):
        list_artifacts(run, "optimise")


def test_list_and_show_on_the_command_line(tmp_path: Path) -> None:
    path = str(make_toy(tmp_path, 4))
    assert b23d("list", path).count("waiting") == 4
    b23d("run", path, "--workers", "0")
    output = b23d("list", path)
    assert output.count("done") == 4 and "toy/s3" in output
    assert json.loads(b23d("list", path, "--json", "--shape", "s2"))[0]["shape"] == "toy/s2"
    assert b23d("list", path, "--stage", "square").count("done") == 4
    assert b23d("show", path) == output, "show without a shape lists them"
    assert "square" in b23d("show", path, "s2") and "toy/s2" in b23d("show", path, "s2")


def test_run_tells_in_json_what_it_did(tmp_path: Path) -> None:
    path = make_toy(tmp_path, 4)
    (tmp_path / "numbers" / "s9.txt").write_text("-13 1")
    told = json.loads(b23d("run", str(path), "--workers", "0", "--json", code=1))
    assert told["run"] == "toy" and told["ok"] is False and told["done"]["square"] == 4
    assert [failure["shape"] for failure in told["failures"]] == ["toy/s9"]
    assert "unlucky" in told["failures"][0]["error"]


def test_quiet_says_only_what_went_wrong(tmp_path: Path) -> None:
    path = make_toy(tmp_path, 3)
    assert b23d("run", str(path), "--workers", "0", "-q") == ""
    (tmp_path / "numbers" / "s9.txt").write_text("-13 1")
    said = b23d("run", str(path), "--workers", "0", "-q", code=1)
    assert "unlucky" in said and "stages" not in said


def test_verbose_says_every_task(tmp_path: Path) -> None:
    said = b23d("run", str(make_toy(tmp_path, 3)), "--workers", "0", "-v")
    assert all(f"square of toy/s{i}" in said for i in range(3))


def test_doctor_tells_in_json() -> None:
    from b23d.stages.workbench.commands import doctor

    told = json.loads(b23d("doctor", "--json"))
    assert {"what", "works", "detail", "mend", "needed"} == set(told[0])
    assert {"python", "torch", "store"} <= {finding["what"] for finding in told}
    assert doctor


def test_params_prints_every_field_of_every_stage() -> None:
    told = json.loads(b23d("params", "--json"))
    for name, stage in load_stages().items():
        model = stage.params
        top = {row["name"].split(".")[2] for row in told.get(f"stages.{name}", [])}
        assert top == set(model.model_fields), name
    assert {row["name"] for row in told["shots"]} >= {"shots.count", "shots.draws", "shots.ids"}
    sigma = next(row for row in told["stages.reweight"] if row["name"] == "stages.reweight.sigma")
    assert sigma["takes"] == "number, ≥ 0" and sigma["default"] == "0.01" and "unit frame" in sigma["means"]


def test_params_says_which_method_uses_a_field() -> None:
    told = {row["name"]: row for row in json.loads(b23d("params", "optimize", "--json"))["stages.optimize"]}
    assert told["stages.optimize.method"]["used"] == ""
    assert 'method = "discrete"' in told["stages.optimize.discrete.starts"]["used"]
    assert "used by" in b23d("params", "optimize")
    with pytest.raises(SelectionError, match="did you mean 'optimize'"):
        b23d("params", "optimise")


def test_version_and_short_help() -> None:
    assert b23d("--version").strip() == f"b23d {version('b23d')}"
    assert "Usage" in b23d("-h") and "Usage" in b23d("run", "-h")


def test_a_limited_run_s_table_is_over_its_targets(tmp_path: Path) -> None:
    """Every target is scored first; the table of `--limit 1` is then over one, and scores.json stays whole."""
    path = make_boxes(tmp_path, 5)
    b23d("run", str(path), "--workers", "0")
    whole = (tmp_path / "boxes" / "scores.json").read_text()
    assert json.loads(whole)["mean"]["targets"] == 3
    shots = {shot.id for draw in Run.load(path).plan().draws for shot in draw.shots}
    target = next(f"b{i}" for i in range(5) if f"b{i}" not in shots)
    run = Run.load(path)
    assert run_scores(run, Selection(shapes=(target,))).mean.targets == 1
    b23d("run", str(path), "--workers", "0", "--shape", target)
    assert (tmp_path / "boxes" / "scores.json").read_text() == whole
    said = b23d("run", str(path), "--workers", "0", "--shape", next(iter(shots)))
    assert "nothing to predict: box/" in said and "are shots of every draw" in said and "is complete" not in said


def test_suggestions_are_shapes_that_have_the_stage(tmp_path: Path) -> None:
    run = Run.load(make_boxes(tmp_path, 3))
    shots = {shot.name for draw in run.plan().draws for shot in draw.shots}
    with pytest.raises(KeyError) as error:
        run.node("nowhere", "optimize")
    assert not any(f"{name!r}" in str(error.value) for name in shots) and "for example 'box/b" in str(error.value)


@pytest.mark.parametrize("typo", ["dinov2-smal", "efficientnet-lite"])
def test_an_encoder_s_typo_gets_a_suggestion_and_no_list(typo: str) -> None:
    with pytest.raises(ValueError, match="did you mean") as error:
        known_name(typo)
    assert len(str(error.value)) < 200


@pytest.mark.parametrize("data", [b"", b"v 0 0 0\nf 1 2 9\n", b"garbage\xff", b"v 0 0 0\nv 1 0 0\nv 0 1\nf 1 2 3\n"])
def test_a_broken_file_is_called_by_its_own_name(tmp_path: Path, data: bytes) -> None:
    path = make_boxes(tmp_path, 3)
    (tmp_path / "shapes" / "box" / "m45.obj").write_bytes(data)
    told = json.loads(b23d("run", str(path), "--workers", "0", "--json", code=1))
    (failure,) = [f["error"] for f in told["failures"] if f["shape"] == "box/m45"]
    assert "m45.obj" in failure and "mesh.obj" not in failure


def test_gc_names_shapes_and_verify_says_how_far(tmp_path: Path) -> None:
    path = make_toy(tmp_path, 3)
    b23d("run", str(path), "--workers", "0")
    assert "checked" in b23d("verify", str(path))
    path.unlink()
    said = b23d("gc", "--dry-run", "--store", str(tmp_path / "store"))
    assert "toy/s0" in said and "would drop" in said


def test_an_outdated_run_lists_what_is_to_run(tmp_path: Path) -> None:
    path = make_toy(tmp_path, 3)
    b23d("run", str(path), "--workers", "0")
    rows = list_shapes(Run.load(path, ["stages.shift.by=2"]))
    assert {row.state for row in rows} == {"waiting"} and rows[0].stages["square"] == "done"
