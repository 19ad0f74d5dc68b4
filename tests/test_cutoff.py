"""Early cut-off: what an upstream gave decides, not how it was made. Nothing below runs again for the same content."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from b23d.pipeline.address import content_digest
from b23d.pipeline.planning.nodes import State
from b23d.pipeline.planning.selection import EVERYTHING, Selection
from b23d.pipeline.run import Run
from b23d.pipeline.scheduling.execution import RunLoop
from b23d.pipeline.scheduling.tasks import Outcome, Task
from b23d.pipeline.scheduling.worker import run_tasks
from b23d.pipeline.stage import STAGES
from tests.toy import Numbers, make_toy
from tests.toy_versions import bump, contents, ran


def test_golden_digests_freeze_content_and_key() -> None:
    """If this fails, what other recipes made is no longer reused, of any store: raise RECIPE."""
    arrays = {"x": {"shape": (2, 3), "dtype": "float32", "sha256": "00ff", "sharded": True, "stored_bytes": 7}}
    values = {"a": 1, "b": float("nan")}
    digest = content_digest("Views", values, arrays)
    assert digest == GOLDEN
    encoded_otherwise = {"x": {**arrays["x"], "shape": [2, 3], "sharded": False, "stored_bytes": 9}}
    assert content_digest("Views", values, encoded_otherwise) == digest
    others = [
        content_digest("View", values, arrays),
        content_digest("Views", {"a": 2, "b": float("nan")}, arrays),
        content_digest("Views", values, {"x": {**arrays["x"], "shape": (3, 2)}}),
        content_digest("Views", values, {"x": {**arrays["x"], "dtype": "int32"}}),
        content_digest("Views", values, {"x": {**arrays["x"], "sha256": "00fe"}}),
        content_digest("Views", values, {"y": arrays["x"]}),
    ]
    assert len({digest, *others}) == 7


GOLDEN = "bcdb33298af4a304f4619c8522ff504ecf355cebef68a44523418475c9c522fd"


def test_a_new_version_that_gives_the_same_runs_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    run.execute(workers=0)
    before = contents(run)
    bump(monkeypatch, "square", 2)
    plan = Run.load(path).plan()
    assert len(plan.to_run()) - plan.behind() == 6 and plan.behind() == 14
    report = Run.load(path).execute(workers=0)
    assert [outcome.stage for outcome in report.done] == ["square"] * 6
    assert len(report.spared) == 14 and all(outcome.spared for outcome in report.spared)
    after = Run.load(path)
    assert after.plan().to_run() == [] and contents(after) == before
    assert after.execute(workers=0).done == []


def test_the_seconds_that_were_spared_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    done = {(o.stage, o.address): o.seconds for o in run.execute(workers=0).done}
    bump(monkeypatch, "square", 2)
    report = Run.load(path).execute(workers=0)
    saved = sum(outcome.seconds for outcome in report.spared)
    assert saved == pytest.approx(sum(s for (stage, _), s in done.items() if stage != "square")) and saved > 0


def test_a_file_saved_again_in_other_words_runs_its_first_stage_alone(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    (tmp_path / "numbers" / "s2.txt").write_text("2.0   3e0\n4.000 5")
    assert ran(Run.load(path)) == {"square": 1}
    assert ran(Run.load(path)) == {}


def test_a_mended_file_runs_what_depends_on_it_and_no_more(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    run.execute(workers=0)
    target = next(t for t in run.plan().draws[0].targets if all(t in d.targets for d in run.plan().draws))
    (tmp_path / "numbers" / f"{target.id}.txt").write_text("7 7 7 8")
    assert ran(Run.load(path)) == {"square": 1, "shift": 1, "add": 2}


def test_a_parameter_that_changes_some_shapes_runs_those(tmp_path: Path) -> None:
    """x⁴ and x² are the same of zeros and ones."""
    path = make_toy(tmp_path, count=5)
    for name, numbers in {"s0": "0 1 1", "s1": "1 0", "s2": "1", "s3": "0 0 1", "s4": "2 3"}.items():
        (tmp_path / "numbers" / f"{name}.txt").write_text(numbers)
    note = STAGES["square"].function

    def quiet(numbers: Numbers, params: object) -> Numbers:
        return Numbers(values=note(numbers, params=params).values)  # type: ignore[attr-defined]

    with pytest.MonkeyPatch.context() as patch:
        bump(patch, "square", 9, quiet)
        ids = {"shots.ids.toy": ["s0", "s1"]}
        overrides = [f"shots.ids={json.dumps({'toy': ids['shots.ids.toy']})}".replace(":", " =")]
        Run.load(path, overrides).execute(workers=0)
        made = ran(Run.load(path, [*overrides, "stages.square.power=4"]))
    assert made == {"square": 5, "shift": 1, "add": 1}


def test_transient_stages_are_seen_through(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_toy(tmp_path)
    transient = ['store.transient=["shift"]', 'outputs=["add", "square"]']
    Run.load(path, transient).execute(workers=0)
    bump(monkeypatch, "square", 2)
    assert ran(Run.load(path, transient)) == {"square": 6}
    assert ran(Run.load(path, transient)) == {}


def test_equal_shapes_are_made_once(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    for i in range(6):
        (tmp_path / "numbers" / f"s{i}.txt").write_text("1 2 3" + " " * i)
    Run.load(path, ['outputs=["square"]']).execute(workers=0)
    report = Run.load(path).execute(workers=0)
    assert report.ok and sum(o.stage == "shift" for o in report.done) == 1
    assert sum(o.stage == "shift" for o in report.spared) == 5 and Run.load(path).plan().to_run() == []


class ManyHands:
    """An executor that has many tasks under way before it hears of the first."""

    address = "here"

    def lane(self, stage: str) -> object:
        return None

    def run(self, next_batch: Callable[[int], list[Task]]) -> Iterator[Outcome]:
        while batches := list(iter(lambda: next_batch(9), [])):
            for tasks in batches:
                yield from run_tasks(tasks)

    def close(self, at_once: bool = False) -> None:
        pass


@pytest.mark.parametrize("unlucky", [False, True])
def test_what_is_made_of_the_same_waits_for_it_and_is_freed_if_it_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unlucky: bool
) -> None:
    path = make_toy(tmp_path)
    for i in range(6):
        (tmp_path / "numbers" / f"s{i}.txt").write_text("1 2 3" + " " * i)
    shift = STAGES["shift"].function

    def fail(square: Numbers, params: object) -> object:
        if unlucky:
            raise ValueError("shift: expected luck, got none")
        return shift(square, params=params)

    Run.load(path, ['outputs=["square"]']).execute(workers=0)
    bump(monkeypatch, "shift", 1, fail)
    run = Run.load(path)
    run.open_to_write()
    _, report = RunLoop(run, EVERYTHING, lambda *_: None, lambda *_: None).go(ManyHands)
    if unlucky:
        failed = {failure.shape for failure in report.failures if failure.stage == "shift"}
        assert failed == {f"toy/s{i}" for i in range(6)} and report.spared == []
    else:
        assert report.ok and sum(outcome.stage == "shift" for outcome in report.done) == 1
        assert sum(outcome.stage == "shift" for outcome in report.spared) == 5 and run.plan().to_run() == []


def test_what_gives_something_else_is_not_reused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    square = STAGES["square"].function

    def other(numbers: Numbers, params: object) -> Numbers:
        return Numbers(values=square(numbers, params=params).values + 1e-12)  # type: ignore[attr-defined]

    bump(monkeypatch, "square", 2, other)
    assert ran(Run.load(path)) == {"square": 6, "shift": 6, "add": 8}


def test_forced_is_forced(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    report = Run.load(path).execute(workers=0, selection=Selection(force=True))
    assert report.ok and len(report.done) == 20 and report.spared == []
    assert Run.load(path).plan().count()["add"][State.CACHED] == 8
