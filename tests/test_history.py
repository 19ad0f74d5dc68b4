"""History: every execution leaves a record; a record can be listed, compared, run again, and keeps what it reached."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from b23d.pipeline.cli import app
from b23d.pipeline.errors import HistoryError
from b23d.pipeline.inspection.again import again, run_of
from b23d.pipeline.inspection.upkeep import reached
from b23d.pipeline.records.history import attach, find, keep, reached_by, records
from b23d.pipeline.run import Run
from b23d.pipeline.store import Store
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
