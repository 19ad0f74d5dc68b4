"""explain, verify and gc on the toy data set."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from b23d.pipeline.inspection.explain import explain
from b23d.pipeline.inspection.upkeep import garbage, known_run_files, reached, verify
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import load_config
from b23d.pipeline.runfile.members import members
from tests.small_runs import b23d
from tests.toy import make_toy


def test_explain_names_the_deepest_field_that_differs(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    shape = Run.load(path).plan().draws[0].targets[0].name
    told = explain(Run.load(path, ["stages.square.power=3"]), shape, "add")
    assert str(told.differences[0]) == "stages.square.power: 2.0 → 3.0" and told.state == "run"
    same = explain(Run.load(path), shape, "add")
    assert same.differences == [] and same.nearest == same.address and same.state == "cached"
    (tmp_path / "numbers" / f"{shape.split('/')[1]}.txt").write_text("7 7")
    moved = explain(Run.load(path), shape, "shift")
    assert moved.differences[0].field == "numbers of square (bytes)"


def test_explain_sees_through_transient_stages(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    transient = 'store.transient=["square"]'
    Run.load(path, [transient]).execute(workers=0)
    told = explain(Run.load(path, [transient, "stages.square.power=3"]), "toy/s0", "shift")
    assert str(told.differences[0]) == "stages.square.power: 2.0 → 3.0"


def test_explain_against_another_run_and_before_any(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    one, two = Run.load(path), Run.load(path, ["stages.shift.by=5"])
    assert explain(one, "toy/s0", "shift").nearest is None
    assert str(explain(two, "toy/s0", "shift", against=one).differences[0]) == "stages.shift.by: 1.0 → 5.0"
    with pytest.raises(KeyError, match="did you mean"):
        explain(one, "s0", "shift")


def test_explain_compares_draws_with_themselves(tmp_path: Path) -> None:
    """Whatever was made last, an artifact is compared with one of its own shots; and where none is stored, it says."""
    path = make_toy(tmp_path, 6)
    for draws in ("[0, 1]", "[1, 0]", "[2]"):
        Run.load(path, [f"shots.draws={draws}"]).execute(workers=0)
    changed = Run.load(path, ["stages.square.power=3"])
    for draw in Run.load(path).plan().draws:
        for shape in draw.targets:
            told = explain(changed, shape.name, "add", draw.seed)
            assert [str(difference) for difference in told.differences] == ["stages.square.power: 2.0 → 3.0"]
            assert told.draws == [draw.seed] and told.shots is None
            same = explain(changed, shape.name, "add", draw.seed, Run.load(path))
            assert same.differences == told.differences and same.shots is None
    plan = Run.load(path, ["shots.draws=[0, 1, 2, 3, 4, 5]", "shots.count=3"]).plan()
    new = next(draw for draw in plan.draws)
    told = explain(Run.load(path, ["shots.count=3"]), new.targets[0].name, "add", 0)
    names = tuple(sorted(shot.name for shot in new.shots))
    assert told.shots is not None and told.shots[1] == names
    assert f"→ {', '.join(names)}" in str(told.differences[0])
    said = b23d("explain", str(path), new.targets[0].name, "add", "--draw", "0", "--set", "shots.count=3")
    assert "another draw: of these shots" in said and ", draw 0: RUN" in said


def test_verify_finds_damage_names_shapes_and_marks_them_to_run(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    run.execute(workers=0)
    assert list(verify(run)) == []
    victims = [run.node("toy/s1", "square"), run.node("toy/s2", "shift")]
    chunk = Path(run.store.path("square", victims[0].address)) / "values" / "c" / "0"
    chunk.write_bytes(chunk.read_bytes()[:-3])
    (Path(run.store.path("shift", victims[1].address)) / "values" / "c" / "0").unlink()
    found = {(d.stage, d.shapes) for d in verify(Run.load(path))}
    assert found == {("square", ("toy/s1",)), ("shift", ("toy/s2",))}
    report = Run.load(path).execute(workers=0)
    assert {(o.stage, o.shape) for o in report.done} == {("square", "toy/s1"), ("shift", "toy/s2")}


def test_gc_drops_only_what_no_run_file_reaches(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path, ["stages.square.power=3", "name=old"]).execute(workers=0)
    run = Run.load(path)
    run.execute(workers=0)
    wanted = set(run.plan().nodes)
    assert garbage(run.store, reached(known_run_files(run.store), run.store)) == [], "what was run with --set counts"
    lost = garbage(run.store, reached(known_run_files(run.store), run.store, as_written=True))
    assert len(lost) == 20 and not {(item.stage, item.address) for item in lost} & wanted
    assert [item.stored_bytes for item in lost] == sorted((item.stored_bytes for item in lost), reverse=True)
    for item in lost:
        run.store.delete(item.stage, item.address)
    assert Run.load(path).plan().to_run() == []


def test_gc_keeps_what_the_members_of_a_sweep_reach(tmp_path: Path) -> None:
    path = make_toy(tmp_path, extra='[sweep]\n"stages.square.power" = [3, 4]\n')
    for member in members(load_config(path)):
        Run.load(path, member.overrides).execute(workers=0)
    run = Run.load(path)
    run.execute(workers=0)
    assert garbage(run.store, reached([path], run.store)) == []
    make_toy(tmp_path, extra='[sweep]\n"stages.square.power" = [3]\n')
    assert garbage(run.store, reached([path], run.store)) == []  # still in the manifests of the sweep as executed
    shutil.rmtree(tmp_path / "toy.sweep")
    lost = garbage(run.store, reached([path], run.store, as_written=True))
    dropped = Run.load(path, ["stages.square.power=4"]).plan().nodes
    assert lost and {(item.stage, item.address) for item in lost} <= set(dropped)


def test_gc_refuses_where_a_run_file_that_used_the_store_cannot_be_read_and_skips_others(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    run.execute(workers=0)
    stranger = tmp_path / "stranger.toml"
    stranger.write_text(path.read_text().replace('root = "numbers"', 'root = "elsewhere"'))
    assert garbage(run.store, reached([path], run.store, besides=[stranger])) == []
    with pytest.raises((ValueError, OSError), match="expected a data set with shapes"):
        reached([path, stranger], run.store)
