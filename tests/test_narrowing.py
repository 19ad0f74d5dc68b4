"""Narrowed runs: a selection runs what it names and what that needs, at the addresses of the whole run."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from b23d.pipeline.cli import app
from b23d.pipeline.planning.nodes import State
from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.run import Run
from tests.toy import make_toy


def ran(path: Path, selection: Selection) -> set[tuple[str, str]]:
    return {(outcome.stage, outcome.shape) for outcome in Run.load(path).execute(workers=0, selection=selection).done}


def test_one_target_runs_with_its_shots_and_nothing_else(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    draw = run.plan().draws[0]
    target, shots = draw.targets[0].name, {shot.name for shot in draw.shots}
    whole = set(run.plan().nodes)
    plan = run.plan(Selection(shapes=(target,)))
    assert set(plan.nodes) < whole
    assert [d.shots for d in plan.draws] == [d.shots for d in run.plan().draws]
    done = ran(path, Selection(shapes=(target,)))
    assert {shape for stage, shape in done if stage == "add"} == {target}
    assert shots <= {shape for stage, shape in done if stage == "shift"}


def test_until_stops_after_the_stage_it_names(tmp_path: Path) -> None:
    assert {stage for stage, _ in ran(make_toy(tmp_path), Selection(until="shift"))} == {"square", "shift"}


def test_one_stage_alone_needs_what_is_above_it_stored(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    blocked = Run.load(path).plan(Selection(stages=("shift",)))
    assert {node.state for node in blocked.nodes.values()} == {State.BLOCKED}
    assert "needs square, which is not stored; use --until shift" in next(iter(blocked.nodes.values())).reason
    ran(path, Selection(until="square"))
    assert {stage for stage, _ in ran(path, Selection(stages=("shift",)))} == {"shift"}


def test_force_makes_again_what_is_selected_and_only_that(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    assert ran(path, Selection()) == set()
    assert ran(path, Selection(shapes=("s1",), stages=("square",), force=True)) == {("square", "toy/s1")}
    assert ran(path, Selection()) == set()


def test_only_failed_are_tried_again(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    (tmp_path / "numbers" / "s3.txt").write_text("-13")
    Run.load(path).execute(workers=0)
    plan = Run.load(path).plan(Selection(only_failed=True))
    assert {node.shape for node in plan.to_run()} == {"toy/s3"}
    (tmp_path / "numbers" / "s3.txt").write_text("13")
    assert "toy/s3" in {shape for _, shape in ran(path, Selection(only_failed=True))}


@pytest.mark.parametrize("verb", ["run", "plan"])
def test_the_command_line_selects(tmp_path: Path, verb: str) -> None:
    path = make_toy(tmp_path)
    words = [verb, str(path), "--shape", "toy/s*", "--class", "toy", "--until", "square", "--limit", "1"]
    done = CliRunner().invoke(app, [*words, *(["--workers", "0"] if verb == "run" else [])])
    assert done.exit_code == 0 and "square" in done.output and "add" not in done.output.replace("address", "")


def test_try_says_what_it_gave(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    same = CliRunner().invoke(app, ["try", str(path), "toy/s1", "shift", "--profile"])
    assert same.exit_code == 0 and "the same as what is stored" in same.output and "function calls" in same.output
    other = CliRunner().invoke(app, ["try", str(path), "toy/s1", "shift", "--set", "stages.shift.by=3"])
    assert other.exit_code == 0 and "nothing is stored at" in other.output


def test_draws_with_the_same_shots_are_said_before_anything_runs(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    path.write_text(path.read_text().replace("count = 2", "count = 6"))
    told = CliRunner().invoke(app, ["plan", str(path)]).output
    assert "class toy: draws 0, 1 have the same 6 shots and are one draw" in told
    path.write_text(path.read_text().replace("count = 6", "count = 2"))
    assert "are one draw" not in CliRunner().invoke(app, ["plan", str(path)]).output
