"""Acceptance: a new version taken for an old one links without recomputing; checked first, recorded, taken back."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from typer.testing import CliRunner

from b23d.pipeline.cli import app
from b23d.pipeline.planning import acceptance
from b23d.pipeline.planning.nodes import State
from b23d.pipeline.run import Run
from b23d.pipeline.stage import STAGES
from tests.toy import Numbers, SquareParams, make_toy


def raise_version(monkeypatch: pytest.MonkeyPatch, stage: str, by: int = 1) -> None:
    monkeypatch.setitem(STAGES, stage, replace(STAGES[stage], version=STAGES[stage].version + by))


def to_run(path: Path) -> Counter[str]:
    return Counter(node.stage for node in Run.load(path).plan().to_run())


def invoke(*words: str) -> tuple[int, str]:
    done = CliRunner().invoke(app, list(words))
    return done.exit_code, done.output


def test_nothing_is_recomputed_after_a_version_is_accepted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    raise_version(monkeypatch, "square")
    whole = to_run(path)
    assert whole["square"] == 6
    code, dry = invoke("accept", str(path), "square")
    assert code == 0 and "6 artifacts of square would be linked" in dry and to_run(path) == whole
    code, done = invoke("accept", str(path), "square", "--check", "2", "--yes")
    assert code == 0 and "2 made anew, and the same" in done and not to_run(path)
    report = Run.load(path).execute(workers=0)
    assert report.ok and not report.done
    code, _ = invoke("accept", str(path), "square", "--revoke")
    assert code == 0 and to_run(path) == whole


def test_what_is_made_below_says_on_whose_word_it_rests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    raise_version(monkeypatch, "square")
    store = Run.load(path).store
    acceptance.accept(store, "square", 2, [1], 0)
    run = Run.load(path, ["stages.shift.by=3"])
    assert run.execute(workers=0).ok
    head = run.store.head("shift", run.node("toy/s0", "shift").address)
    assert head.provenance["accepted"] == ["square of version 1"]


def test_a_check_that_differs_accepts_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    monkeypatch.setitem(STAGES, "square", replace(STAGES["square"], version=2, function=_doubled))
    code, told = invoke("accept", str(path), "square", "--check", "1", "--yes")
    assert code == 1 and "differs, nothing is accepted: values" in told and to_run(path)["square"] == 6


def _doubled(numbers: Numbers, params: SquareParams) -> Numbers:
    return Numbers(values=numbers.values**params.power * 2, note=f"power {params.power}")


def test_an_acceptance_is_of_one_version_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    raise_version(monkeypatch, "square")
    acceptance.accept(Run.load(path).store, "square", 2, [1], 0)
    assert not to_run(path)
    raise_version(monkeypatch, "square")
    assert to_run(path)["square"] == 6
    assert {node.state for node in Run.load(path).plan().nodes.values()} == {State.RUN}


def test_a_note_that_cannot_be_read_counts_for_nothing(tmp_path: Path) -> None:
    store = Run.load(make_toy(tmp_path)).store
    Run.load(tmp_path / "toy.toml").execute(workers=0)
    acceptance.accept(store, "square", 2, [1], 3)
    (Path(store.root) / ".accepted" / "shift-2.json").write_text("{")
    assert [(a.stage, a.version, a.takes, a.checked) for a in acceptance.acceptances(store)] == [("square", 2, (1,), 3)]
    assert acceptance.revoke(store, "square", 2) and not acceptance.revoke(store, "square", 2)


def test_nothing_to_accept_is_said(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    code, told = invoke("accept", str(path), "square")
    assert code == 0 and "nothing to accept" in told
