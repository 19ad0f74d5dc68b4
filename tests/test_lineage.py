"""Lineage: a bad input is followed to every number that it touched; why tasks are to run is counted."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from b23d.pipeline.cli import app
from b23d.pipeline.inspection.explain import explain
from b23d.pipeline.inspection.lineage import descent, reasons
from b23d.pipeline.run import Run
from tests.small_runs import make_boxes
from tests.toy import make_toy


def test_a_targets_artifact_reaches_its_own_results_only(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    run = Run.load(path)
    shots = {shot.name for draw in run.plan().draws for shot in draw.shots}
    target = next(shape.name for shape in run.shapes if shape.name not in shots)
    told = descent(run, target, "square")
    assert {node.shape for nodes in told.below.values() for node in nodes} == {target}
    assert set(told.below) == {"shift", "add"} and len(told.below["add"]) == 2 and not told.as_shot


def test_a_shot_reaches_every_target_of_its_draws(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    draw = run.plan().draws[0]
    told = descent(run, draw.shots[0].name, "square")
    assert {shape.name for shape in draw.targets} <= told.as_shot


def test_a_wrong_annotation_is_followed_from_the_leaf(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    report = Run.load(path).execute(workers=0)
    run = Run.load(path)
    shot = run.plan().draws[0].shots[0].name
    told = descent(run, shot, "keypoints")
    assert set(told.below) == {"add"} and [record.id for record in told.recorded] == [report.record]
    with pytest.raises(KeyError, match="expected a stage or leaf"):
        descent(run, shot, "nonsense")


def test_reasons_are_counted_over_what_waits_for_nothing(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    assert reasons(run, run.plan()) == ({"square was never made": 6}, 14)
    run.execute(workers=0)
    other = Run.load(path, ["stages.square.power=3"])
    assert reasons(other, other.plan()) == ({"stages.square.power: 2.0 → 3.0 changed": 6}, 14)
    (tmp_path / "numbers" / "s3.txt").write_text("7 8")
    mended = Run.load(path)
    found, _ = reasons(mended, mended.plan())
    assert found == {"numbers of square (bytes) changed": 1}


def test_the_command_line_tells_both_ways(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    why = CliRunner().invoke(app, ["plan", str(path), "--why"])
    assert why.exit_code == 0 and "6 × square was never made" in why.output and "14 × behind these" in why.output
    down = CliRunner().invoke(app, ["explain", str(path), "toy/s0", "square", "--down"])
    assert down.exit_code == 0 and "made from square of toy/s0" in down.output


def test_a_choice_comes_before_the_fields_it_brings(tmp_path: Path) -> None:
    path = make_boxes(tmp_path)
    graph, heat = Run.load(path), Run.load(path, ["stages.geodesic.method=heat"])
    for now, before in ((heat, graph), (graph, heat)):
        found = explain(now, "box/b0", "geodesic", against=before).differences
        assert len(found) > 1 and found[0].field == "stages.geodesic.method", found
