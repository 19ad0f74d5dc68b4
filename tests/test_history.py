"""History: every execution leaves a record; a record can be listed, compared, run again, and keeps what it reached."""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from b23d.pipeline.cli import app
from b23d.pipeline.errors import HistoryError
from b23d.pipeline.inspection.again import again, run_of
from b23d.pipeline.inspection.upkeep import reached
from b23d.pipeline.planning.selection import Selection
from b23d.pipeline.records.history import attach, find, keep, reached_by, records
from b23d.pipeline.run import Run
from b23d.pipeline.store import Store
from tests.small_runs import b23d, make_boxes
from tests.toy import make_toy


def test_every_execution_leaves_a_record(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    first = Run.load(path).execute(workers=0)
    second = Run.load(path, ["stages.add.weight=2"]).execute(workers=0)
    store = Run.load(path).store
    one, two = records(store)
    assert [one.id, two.id] == [first.record, second.record]
    assert one.ended == "complete" and one.overrides == [] and one.made == {"square": 6, "shift": 6, "add": 8}
    assert two.overrides == ["stages.add.weight=2"] and two.made == {"add": 8} and two.reached["square"] == 6
    assert two.params["add"] == {"weight": 2.0} and two.environment["versions"]["python"]
    assert reached_by(store, one) == Run.load(path).plan().reached()


def test_what_fails_and_what_is_stopped_is_recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_toy(tmp_path)
    (tmp_path / "numbers" / "s3.txt").write_text("-13")
    Run.load(path).execute(workers=0)
    record = records(Run.load(path).store)[-1]
    assert record.ended == "incomplete" and any("unlucky" in line for line in record.failures) and record.blocked

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Run.load(path, ["stages.square.power=3"]).execute(workers=0, watch=interrupted)
    assert records(Run.load(path).store)[-1].ended == "stopped"


def test_a_record_runs_again_as_it_was_though_the_file_has_changed(tmp_path: Path) -> None:
    path = make_toy(tmp_path, extra="[stages.square]\npower = 3\n")
    Run.load(path, ["stages.add.weight=2"]).execute(workers=0)
    store = Run.load(path).store
    record = records(store)[-1]
    path.write_text(path.read_text().replace("power = 3", "power = 4").replace("draws = [0, 1]", "draws = [1]"))
    restored = again(record, store)
    assert restored.plan().reached() == reached_by(store, record)
    assert run_of(record.id[:-1], store=str(store.root)).plan().reached() == reached_by(store, record)
    path.unlink()
    with pytest.raises(HistoryError, match="expected its run file"):
        again(record, store)


def test_gc_keeps_what_a_kept_record_reached(tmp_path: Path) -> None:
    path = make_toy(tmp_path, extra="[stages.square]\npower = 3\n")
    Run.load(path).execute(workers=0)
    store = Run.load(path).store
    record = records(store)[-1]
    path.write_text(path.read_text().replace("power = 3", "power = 4"))
    Run.load(path).execute(workers=0)
    lost = reached_by(store, record) - reached([path], store)
    assert lost
    keep(store, record, True)
    assert not reached_by(store, record) - reached([path], store)
    keep(store, record, False)
    assert reached_by(store, record) - reached([path], store) == lost


def test_records_are_found_by_the_beginning_of_their_id(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    first, second = Run.load(path).execute(workers=0), Run.load(path).execute(workers=0)
    store = Run.load(path).store
    attach(store, first.record, "scores", {"mean": 1})
    assert find(store, first.record).results == {"scores": {"mean": 1}}
    with pytest.raises(HistoryError, match="got 2 of them"):
        find(store, first.record[:6])
    with pytest.raises(HistoryError, match="got none"):
        find(store, "no-such")
    assert second.done == []


def test_a_damaged_record_hides_no_other(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    report = Run.load(path).execute(workers=0)
    store = Run.load(path).store
    (Path(store.root) / ".records" / "000000-000000-aaaa.json").write_text("{")
    assert [record.id for record in records(Store(store.url))] == [report.record]


def test_the_command_line_tells_history(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    words = ["run", str(path), "--workers", "0", "--set"]
    assert CliRunner().invoke(app, [*words, "stages.add.weight=2"]).exit_code == 0
    assert CliRunner().invoke(app, [*words, "stages.add.weight=3"]).exit_code == 0
    store = str(Run.load(path).store.root)
    listed = CliRunner().invoke(app, ["log", str(path), "--json"])
    ids = [record["id"] for record in json.loads(listed.output)]
    assert len(ids) == 2
    told = CliRunner().invoke(app, ["log", ids[0], "--store", store, "--keep"])
    assert told.exit_code == 0 and "stages.add.weight=2" in told.output.replace("\n", "") and "complete" in told.output
    table = CliRunner().invoke(app, ["log", "--store", store])
    assert table.exit_code == 0 and all(name in table.output for name in ids)
    repeated = CliRunner().invoke(app, ["run", "--again", ids[0], "--store", store, "--workers", "0"])
    assert repeated.exit_code == 0 and "nothing to do" in repeated.output
    neither = CliRunner().invoke(app, ["run"])
    assert neither.exit_code == 2 and "--again" in neither.output


def test_history_tells_what_was_selected_and_again_selects_it(tmp_path: Path) -> None:
    path = str(make_toy(tmp_path))
    b23d("run", path, "--workers", "0", "--shape", "s0", "--until", "shift", "--set", "stages.square.power=3")
    said = b23d("run", path, "--workers", "0", "--shape", "s0", "--until", "shift", "--set", "stages.square.power=3")
    assert "nothing to do: of toy, all that --shape s0 --until shift selects is there" in said
    assert "nothing to do: toy is complete" not in said
    store = Run.load(path).store
    selected = {"shapes": ["s0"], "until": "shift"}
    assert [record.selection for record in records(store)] == [selected, selected]
    assert "--shape s0" in b23d("log", path) and "--until shift" in b23d("log", path)
    again = b23d("run", "--again", records(store)[0].id, "--store", str(store.root), "--workers", "0")
    assert "nothing to do: of toy, all that --shape s0 --until shift" in again
    assert "failed before" in b23d("run", path, "--workers", "0", "--only-failed")
    assert "; --shape s0 --until shift" in (tmp_path / "toy" / "run.log").read_text()


def test_a_record_is_told_in_lines_and_in_full_as_json(tmp_path: Path) -> None:
    path = str(make_boxes(tmp_path, 4))
    b23d("run", path, "--workers", "0", "--set", "stages.reweight.sigma=0.0123456")
    (record,) = records(Run.load(path).store)
    told = b23d("log", record.id, "--store", str(tmp_path / "store"))
    assert "sigma=0.01235" in told and "IoU" in told and "sym. PCK" in told, "tables, as after the run"
    assert '{"' not in told and not re.search(r"\d\.\d{9}", told)
    assert json.loads(b23d("log", record.id, "--store", str(tmp_path / "store"), "--json")) == asdict(record)


def test_a_result_that_nothing_draws_is_told_plainly(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    report = Run.load(path).execute(workers=0)
    store = Run.load(path).store
    attach(store, report.record, "scores", {"old": {"mean": [0.14285714285714285, 1.0]}})
    attach(store, report.record, "mine", {"a": {"b": 0.33333333}})
    told = b23d("log", report.record, "--store", str(store.root))
    assert "old.mean" in told and "[0.1429, 1]" in told and "a.b" in told and "0.3333" in told


@pytest.mark.parametrize(
    ("selection", "words"),
    [
        (Selection(), ""),
        (Selection(("a/*", "b"), ("c",), 2, ("extract",)), "--shape a/* --shape b --class c --limit 2 --stage extract"),
        (Selection(until="render", only_failed=True, force=True), "--until render --only-failed --force"),
    ],
)
def test_a_selection_says_the_options_that_made_it(selection: Selection, words: str) -> None:
    assert selection.words == words
    told = json.loads(json.dumps({key: value for key, value in asdict(selection).items() if value}))
    assert Selection.recorded({**told, "of a later version": 1}) == selection


def test_what_a_task_says_is_kept_with_what_it_made_and_with_its_failure(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    (tmp_path / "numbers" / "s3.txt").write_text("-0.5 1 2 3")  # a root of a negative number: numpy warns
    run = Run.load(path, ["stages.square.power=0.5"])
    run.execute(workers=0)
    head = run.store.head("square", run.node("toy/s3", "square").address)
    assert "RuntimeWarning: invalid value" in head.provenance["said"]
    assert set(head.provenance["parts"]) == {"square", "reading"}
    quiet = run.store.head("square", run.node("toy/s1", "square").address)
    assert quiet.provenance["said"] == ""
    shown = CliRunner().invoke(app, ["show", str(path), "toy/s3", "square", "--set", "stages.square.power=0.5"])
    assert "RuntimeWarning" in shown.output


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"selection": None}, False),
        ({"environment": None}, False),
        ({"failures": None}, False),
        ({"failures": 3}, False),
        ({"began": None}, False),
        ({"results": {"scores": None}}, True),
        ({"results": {"scores": [1, 2]}}, True),
        ({"results": {"parts": {"classes": 3}}}, True),
        ({"results": {"scores": {"mean": {"auc": {"mean": "high"}}}}}, True),
        ({"of a later version": 1}, True),
    ],
)
def test_an_odd_record_hides_no_other(tmp_path: Path, changed: dict[str, Any], told: bool) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    (own,) = (tmp_path / "store" / ".records").glob("*.json")
    odd = {**json.loads(own.read_text()), **changed, "id": "200101-000000-odd"}
    (own.parent / f"{odd['id']}.json").write_text(json.dumps(odd))
    printed = b23d("log", str(path))
    assert own.stem in printed and (odd["id"] in printed) == told
    if told:
        assert odd["id"] in b23d("log", odd["id"], "--store", str(tmp_path / "store"))
