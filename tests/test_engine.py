"""Plan, execute, resume, quarantine: the engine on a toy data set that knows no 3D."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from b23d.pipeline.errors import ResourceError
from b23d.pipeline.planning.draws import draw_shots
from b23d.pipeline.planning.nodes import State
from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.run import Run
from b23d.pipeline.stage import STAGES
from b23d.pipeline.store import Store
from b23d.schemas.runfile import Shots
from tests.toy import Numbers, make_toy


def states(run: Run) -> dict[str, dict[str, int]]:
    return {stage: {state.value: n for state, n in counts.items()} for stage, counts in run.plan().count().items()}


def values(run: Run, shape: str, stage: str) -> np.ndarray:
    artifact = run.artifact(shape, stage)
    assert isinstance(artifact, Numbers)
    return artifact.values


def test_a_run_makes_what_it_says_and_a_second_does_nothing(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    assert states(run) == {"square": {"run": 6}, "shift": {"run": 6}, "add": {"run": 8}}
    report = run.execute(workers=0)
    assert report.ok and len(report.done) == 20
    np.testing.assert_array_equal(values(run, "toy/s1", "shift"), np.array([1, 4, 9, 16]) + 1.0)
    again = Run.load(path).execute(workers=0)
    assert again.ok and again.done == []
    assert states(Run.load(path)) == {"square": {"cached": 6}, "shift": {"cached": 6}, "add": {"cached": 8}}


def test_a_parameter_re_runs_what_depends_on_it_and_nothing_else(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    assert states(Run.load(path, ["stages.add.weight=2"])) == {
        "square": {"cached": 6},
        "shift": {"cached": 6},
        "add": {"run": 8},
    }
    assert states(Run.load(path, ["stages.shift.by=2"])) == {
        "square": {"cached": 6},
        "shift": {"run": 6},
        "add": {"run": 8},
    }
    assert states(Run.load(path, ["stages.add.weight=1.0"]))["add"] == {"cached": 8}


def test_a_new_shape_runs_alone_and_an_edited_one_again(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    (tmp_path / "numbers" / "new8.txt").write_text("3 4")
    (tmp_path / "numbers" / "new9.txt").write_text("3 4 5")
    run = Run.load(path)
    assert not {s.name for d in run.plan().draws for s in d.shots} & {"toy/new8", "toy/new9"}, (
        "choose other names: these rank first"
    )
    assert states(run) == {
        "square": {"run": 2, "cached": 6},
        "shift": {"run": 2, "cached": 6},
        "add": {"run": 4, "cached": 8},
    }
    os.utime(tmp_path / "numbers" / "s0.txt")
    assert states(Run.load(path))["square"] == {"run": 2, "cached": 6}


def test_another_draw_runs_only_what_sees_shots(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    found = states(Run.load(path, ["shots.draws=[0, 1, 5]"]))
    assert found["square"] == {"cached": 6} and found["shift"] == {"cached": 6} and found["add"].get("cached") == 8


def test_where_things_are_does_not_matter(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    path = make_toy(tmp_path / "a")
    here = Run.load(path).plan()
    (tmp_path / "a").rename(tmp_path / "b")
    there = Run.load(tmp_path / "b" / "toy.toml").plan()
    assert here.nodes.keys() == there.nodes.keys()


def test_a_failed_shape_is_quarantined_and_the_rest_finishes(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    bad = tmp_path / "numbers" / "bad.txt"
    bad.write_text("-13 1")
    report = Run.load(path).execute(workers=0)
    assert not report.ok and [f.shape for f in report.failures] == ["toy/bad"]
    assert "toy/bad" in report.failures[0].error and "unlucky" in report.failures[0].error
    assert len([o for o in report.done if o.stage == "add"]) == 8
    again = Run.load(path).execute(workers=0)
    assert not again.ok and again.done == [] and len(again.failures) == 1, "the next run retries only the bad one"
    bad.write_text("-12 1")
    mended = Run.load(path).execute(workers=0)
    assert mended.ok and {o.shape for o in mended.done if o.stage == "square"} == {"toy/bad"}


def test_a_bad_shot_is_replaced_by_the_next_in_rank(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    first = Run.load(path).plan().draws[0].shots[0]
    (tmp_path / "numbers" / f"{first.id}.txt").write_text("-13")
    report = Run.load(path).execute(workers=0)
    plan = Run.load(path).plan()
    assert first.name not in {s.name for d in plan.draws for s in d.shots}
    assert {f.shape for f in report.failures} == {first.name}
    assert plan.count()["add"][State.CACHED] == 6, "5 good shapes, 2 of them shots, 2 draws"


def test_what_fails_on_shots_alone_names_them_and_its_draw(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(**_: object) -> Numbers:
        raise ValueError("shot 1: expected a number like shot 0's, got another; mend it (shot 7 is none of them)")

    monkeypatch.setitem(STAGES, "total", replace(STAGES["total"], function=fails))
    path = make_toy(tmp_path)
    run = Run.load(path, ['outputs=["total"]', "shots.draws=[4]"])
    first, second = (shot.name for shot in run.plan().draws[0].shots)
    (failure,) = run.execute(workers=0).failures
    told = (
        f"shot 1 ({second}): expected a number like shot 0 ({first})'s, got another; mend it (shot 7 is none of them)"
    )
    assert failure.error == f"ValueError: toy, draw 4: {told}"


def test_a_missing_file_blocks_its_shape_only(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    lost = run.shapes[3]
    (tmp_path / "numbers" / f"{lost.id}.txt").unlink()
    report = run.execute(workers=0)
    assert [f.shape for f in report.failures] == [lost.name] and "No such file" in report.failures[0].error
    assert run.plan().count()["square"][State.CACHED] == 5


def test_too_few_shots_is_the_class_own_problem(tmp_path: Path) -> None:
    path = make_toy(tmp_path, count=3)
    report = Run.load(path, ["shots.count=4"]).execute(workers=0)
    assert not report.ok and "class toy: expected 4 annotated shapes as shots, got 3" in report.failures[0].error


def test_transient_stages_are_not_stored_and_run_inside(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path, ['store.transient=["square"]'])
    assert run.plan().inlined() == {"square": 6}
    report = run.execute(workers=0)
    assert report.ok and {o.stage for o in report.done} == {"shift", "add"} and run.store.stages() == ["add", "shift"]
    kept = Run.load(path, store=str(tmp_path / "kept"))
    kept.execute(workers=0)
    np.testing.assert_array_equal(values(run, "toy/s2", "add"), values(kept, "toy/s2", "add"))


def test_limit_keeps_the_draws(tmp_path: Path) -> None:
    run = Run.load(make_toy(tmp_path))
    whole, few = run.plan(), run.plan(Selection(limit=2))
    assert [d.shots for d in whole.draws] == [d.shots for d in few.draws]
    assert few.nodes.keys() < whole.nodes.keys()


def test_draws_are_stable_and_seeded() -> None:
    from b23d.pipeline.dataset import Leaf, Shape

    leaf = Leaf(dict)  # type: ignore[arg-type]
    shapes = [Shape(f"m{i}", "c", {"keypoints": leaf}) for i in range(40)]
    draws = draw_shots(shapes, Shots(count=3, draws=list(range(20))), (), {"keypoints"})
    assert len({tuple(s.id for s in d.shots) for d in draws}) > 15
    assert all(len(d.targets) == 37 and not {s.id for s in d.shots} & {s.id for s in d.targets} for d in draws)
    more = draw_shots(
        [*shapes, Shape("new", "c", {"keypoints": leaf})], Shots(count=3, draws=list(range(20))), (), {"keypoints"}
    )
    same = sum(a.shots == b.shots for a, b in zip(draws, more, strict=True))
    assert same >= 15, "a new shape enters a draw with probability 3/41"


def test_shots_have_what_the_run_s_stages_ask_of_them() -> None:
    """Keypoints, parts, or both; a class that has only one of them is drawn by that one."""
    from b23d.pipeline.dataset import Leaf, Shape

    leaf = Leaf(dict)  # type: ignore[arg-type]
    names = [["source"] + ["keypoints"] * (i % 2) + ["parts"] * (i > 4) for i in range(10)]
    some = [Shape(f"m{i}", "some", dict.fromkeys(names[i], leaf)) for i in range(10)]
    parts = [Shape(f"m{i}", "parts", {"source": leaf, "parts": leaf}) for i in range(4)]
    options = Shots(count=2, draws=list(range(10)))

    def shots(leaves: set[str]) -> dict[str, set[str]]:
        found: dict[str, set[str]] = {}
        for draw in draw_shots([*some, *parts, Shape("x", "bare", {"source": leaf})], options, (), leaves):
            found.setdefault(draw.category, set()).update(shape.id for shape in draw.shots)
        return found

    assert shots({"keypoints"}).keys() == {"some"}
    assert shots({"keypoints"})["some"] <= {"m1", "m3", "m5", "m7", "m9"}
    assert shots({"parts"})["some"] <= {"m5", "m6", "m7", "m8", "m9"}
    both = shots({"keypoints", "parts"})
    assert both.keys() == {"some", "parts"} and both["some"] <= {"m5", "m7", "m9"}
    assert shots(set()) == {}


def test_what_sees_shots_alone_is_made_once_a_draw(tmp_path: Path) -> None:
    """It does not depend on the target, not even on a first target that cannot be read."""
    run = Run.load(make_toy(tmp_path), ['outputs=["use"]'])
    plan = run.plan()
    assert {stage: sum(n.values()) for stage, n in plan.count().items()} == {
        "square": 6,
        "shift": 6,
        "total": 2,
        "use": 8,
    }
    assert sorted(tuple(node.draws) for node in plan.nodes.values() if node.stage == "total") == [(0,), (1,)]
    (tmp_path / "numbers" / f"{plan.draws[0].targets[0].id}.txt").unlink()
    report = run.execute(workers=0)
    made = [outcome for outcome in report.done if outcome.stage == "total"]
    assert len(made) == 2 and len({outcome.address for outcome in made}) == 2
    assert len([outcome for outcome in report.done if outcome.stage == "use"]) >= 6, "all other targets"
    shots = [shot.name for shot in run.plan().draws[0].shots]
    wanted = sum(values(run, shot, "shift").sum() for shot in shots)
    totals = [
        artifact.values[0] for _, draw, artifact in run.collect("total") if draw == 0 and isinstance(artifact, Numbers)
    ]
    assert totals and set(totals) == {wanted}


def test_dask_gives_what_inline_gives(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    (tmp_path / "numbers" / "bad.txt").write_text("-13 1")
    (tmp_path / "numbers" / "deadly.txt").write_text("-99 1")
    report = Run.load(path).execute(workers=2)
    errors = {f.shape: f.error for f in report.failures}
    assert set(errors) == {"toy/bad", "toy/deadly"}
    assert "worker" in errors["toy/deadly"] and "death" in errors["toy/deadly"]
    assert len([o for o in report.done if o.stage == "add"]) >= 8, "the dead worker's other tasks are run again"
    run = Run.load(path)
    for _, _, artifact in run.collect("square"):
        assert isinstance(artifact, Numbers) and artifact.values.size


def test_a_resource_no_worker_has_is_an_error_before_the_run(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path, ['outputs=["needs_gpu"]'])
    with pytest.raises(ResourceError, match="stage needs_gpu: expected a worker with 1 gpu"):
        run.execute(workers=1)
    assert run.store.stages() == []


@pytest.mark.parametrize("seed", range(3))
def test_killed_at_random_and_resumed_loses_and_repeats_nothing(tmp_path: Path, seed: int) -> None:
    """Artifacts finished before a SIGKILL are whole, and stay the ones they were."""
    path = make_toy(tmp_path, count=12, extra="[stages.square]\npause = 0.05\n")
    code = f"import tests.toy; from b23d.pipeline.run import Run; Run.load({str(path)!r}).execute(workers=0)"
    process = subprocess.Popen([sys.executable, "-c", code], cwd=Path(__file__).parents[1])
    time.sleep(1.2 + random.Random(seed).random() * 0.6)
    process.send_signal(signal.SIGKILL)
    process.wait()
    store = Store(tmp_path / "store")
    finished = {
        (stage, a): store.head(stage, a).provenance["created"]
        for stage in store.stages()
        for a in store.addresses(stage)
    }
    assert not any(store.damage(stage, a) for stage, a in finished)
    report = Run.load(path).execute(workers=0)
    assert report.ok and not {(o.stage, o.address) for o in report.done} & finished.keys()
    assert Run.load(path).plan().to_run() == []
