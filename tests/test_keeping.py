"""What a store keeps: roots before the first task, leases, foreign files, half-removed folders, other folders."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path

import pytest

from b23d.pipeline.errors import NotAStoreError, StoreError
from b23d.pipeline.inspection.upkeep import garbage, known_run_files, reached, verify
from b23d.pipeline.planning.nodes import State
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.run import Run
from b23d.pipeline.scheduling.tasks import Outcome, Task
from b23d.pipeline.storage import roots as roots_module
from b23d.pipeline.storage.index import Index
from b23d.pipeline.storage.marker import MARKER
from b23d.pipeline.storage.roots import FOLDER, lease, note_root, roots
from b23d.pipeline.store import Store
from tests.toy import make_toy


def collect(store: Store, as_written: bool = False) -> int:
    """What `b23d gc` does; how many it drops."""
    lost = garbage(store, reached(known_run_files(store), store, as_written=as_written))
    for item in lost:
        store.delete(item.stage, item.address)
    return len(lost)


class Killed(BaseException):
    pass


def kill_after(count: int):  # type: ignore[no-untyped-def]
    done = []

    def watch(plan: Plan, outcome: Outcome | Task) -> None:
        done.extend([] if isinstance(outcome, Task) else [outcome])
        if len(done) == count:
            raise Killed

    return watch


@pytest.mark.parametrize("overrides", [[], ["stages.square.power=3"], ["shots.draws=[4]", "stages.shift.by=2"]])
def test_gc_beside_a_run_keeps_all_it_makes(tmp_path: Path, overrides: list[str]) -> None:
    """The first run with this file, after every task."""
    path = make_toy(tmp_path)
    dropped = []
    run = Run.load(path, overrides)
    report = run.execute(workers=0, watch=lambda plan, outcome: dropped.append(collect(Store(tmp_path / "store"))))
    assert report.ok and set(dropped) == {0} and Run.load(path, overrides).plan().to_run() == []


@pytest.mark.parametrize("overrides", [[], ["stages.square.power=3"]])
def test_a_killed_run_s_artifacts_stay(tmp_path: Path, overrides: list[str]) -> None:
    path = make_toy(tmp_path)
    with pytest.raises(Killed):
        Run.load(path, overrides).execute(workers=0, watch=kill_after(9))
    assert collect(Store(tmp_path / "store")) == 0
    report = Run.load(path, overrides).execute(workers=0)
    assert report.ok and len(report.done) == 20 - 9


def test_what_was_run_with_set_stays_unless_told_otherwise(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    Run.load(path, ["stages.shift.by=3"]).execute(workers=0)
    store = Store(tmp_path / "store")
    assert collect(store) == 0
    assert collect(store, as_written=True) == 14, "shift and add of that run"
    assert Run.load(path).plan().to_run() == []


def test_a_part_of_a_run_does_not_forget_the_rest(tmp_path: Path) -> None:
    from b23d.pipeline.planning.selection import Selection

    path = make_toy(tmp_path)
    overrides = ["stages.shift.by=3"]
    Run.load(path, overrides).execute(workers=0)
    Run.load(path, overrides).execute(workers=0, selection=Selection(limit=1))
    assert collect(Store(tmp_path / "store")) == 0


def test_a_lease_keeps_what_no_run_file_names_until_it_is_old(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    store = Store(tmp_path / "store")
    (name,) = [file.stem for file in (tmp_path / "store" / FOLDER).glob("*.json")]
    path.unlink()
    with lease(store, name):
        assert [root.leased for root in roots(store)] == [True] and collect(store) == 0
        monkeypatch.setattr(time, "time", lambda: 1e12)
        assert [root.leased for root in roots(store)] == [False]
        monkeypatch.undo()
    assert [root.leased for root in roots(store)] == [False]
    assert collect(store) == 20


def test_a_lease_is_touched_while_it_is_held(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(roots_module, "BEAT", 0.01)
    store = Store(tmp_path)
    name = note_root(store, tmp_path / "x.toml", [], {})
    with lease(store, name):
        (file,) = (tmp_path / FOLDER).glob("*.lease")
        first = json.loads(file.read_text())["time"]
        deadline = time.monotonic() + 20
        while json.loads(file.read_text())["time"] == first and time.monotonic() < deadline:
            time.sleep(0.01)
        assert json.loads(file.read_text())["time"] > first
    assert not file.exists()


def test_a_root_that_cannot_be_read_stops_gc(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    (root,) = (tmp_path / "store" / FOLDER).glob("*.json")
    root.write_text(root.read_text()[:99])
    with pytest.raises(StoreError, match="remove that file"):
        collect(Store(tmp_path / "store"))


def litter(store: Path) -> list[Path]:
    """What finders, explorers and people leave behind, at every depth."""
    stage = next(path for path in sorted(store.iterdir()) if path.name == "shift")
    fan = sorted(stage.iterdir())[0]
    artifact = sorted(fan.iterdir())[0]
    files = [
        folder / name for folder in (store, stage, fan, artifact) for name in (".DS_Store", "Thumbs.db", "notes.txt")
    ]
    for file in files:
        file.write_bytes(b"\x00litter")
    folders = [
        store / "my thesis",
        store / ".cache",
        stage / "ab" / "thesis",
        stage / "zz",
        fan / "old",
        store / "docs" / "ab" / "thesis",
    ]
    for folder in folders:
        folder.mkdir(parents=True)
        (folder / "zarr.json").write_text("dear diary")
    (stage / "cd").write_text("a file where a fan would be") if not (stage / "cd").exists() else None
    (store / "loop").symlink_to(store)
    (store / "dangling").symlink_to(store / "nowhere")
    (store / ".writing" / "file").write_text("?")
    (store / FOLDER / "notes.json").write_text("?")
    return [*files, *folders]


def test_foreign_files_are_left_alone_and_break_nothing(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    left = litter(tmp_path / "store")
    run = Run.load(path)
    assert run.plan().to_run() == [] and run.store.stages() == ["add", "shift", "square"]
    assert list(verify(run)) == [] and collect(run.store) == 0
    assert Run.load(path, ["stages.shift.by=5"]).execute(workers=0).ok
    run.store.drop_leftovers(older_than=-1)
    assert all(file.exists() for file in left)


def test_a_half_removed_folder_is_not_complete_and_heals(tmp_path: Path) -> None:
    """As older programs left them, and as anybody may: without a head, or with nothing in it."""
    path = make_toy(tmp_path)
    run = Run.load(path)
    run.execute(workers=0)
    nodes = [run.node(f"toy/s{i}", "shift") for i in (1, 2)]
    folders = [Path(run.store.path("shift", node.address)) for node in nodes]
    (folders[0] / "zarr.json").unlink()
    shutil.rmtree(folders[1])
    folders[1].mkdir()
    plan = Run.load(path).plan()
    assert {node.shape for node in plan.to_run() if node.stage == "shift"} == {"toy/s1", "toy/s2"}
    assert Run.load(path).execute(workers=0).ok
    assert list(verify(Run.load(path))) == [] and Run.load(path).plan().to_run() == []


def test_deleting_is_never_half_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Interrupted at any step: the artifact is whole, or it is gone."""
    path = make_toy(tmp_path)
    run = Run.load(path)
    run.execute(workers=0)
    address = run.node("toy/s1", "shift").address

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    for name in ("rename", "mkdir"):
        with monkeypatch.context() as patch:
            patch.setattr(Path, name, interrupted)
            with pytest.raises(KeyboardInterrupt):
                run.store.delete("shift", address)
        assert run.store.damage("shift", address) == []
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "rmtree", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run.store.delete("shift", address)
    assert address not in run.store.addresses("shift") and list((tmp_path / "store" / ".writing").iterdir())
    run.store.drop_leftovers()
    assert not list((tmp_path / "store" / ".writing").iterdir())


def test_gc_and_verify_refuse_a_folder_that_is_no_store(tmp_path: Path) -> None:
    (tmp_path / "docs" / "ab" / "thesis").mkdir(parents=True)
    (tmp_path / "docs" / "ab" / "thesis" / "text.tex").write_text("years of work")
    for folder in (tmp_path, tmp_path / "docs", tmp_path / "nowhere"):
        with pytest.raises(NotAStoreError, match="expected a store"):
            Store(folder).check_is_store()
    assert list(tmp_path.rglob("*.tex"))


def test_a_newer_store_is_refused_and_an_unmarked_one_adopted(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    marker = tmp_path / "store" / MARKER
    told = json.loads(marker.read_text())
    marker.write_text(json.dumps({**told, "format": told["format"] + 1}))
    for act in (lambda: Run.load(path), lambda: Store(tmp_path / "store").check_is_store()):
        with pytest.raises(NotAStoreError, match="newer"):
            act()
    for broken in (None, "", "{", '{"format": "x"}'):
        marker.unlink(missing_ok=True)
        if broken is not None:
            marker.write_text(broken)
        assert Run.load(path).plan().to_run() == []
        Store(tmp_path / "store").check_is_store()
        assert collect(Store(tmp_path / "store")) == 0
        Run.load(path).execute(workers=0)
        assert json.loads(marker.read_text()) == told


def test_what_used_the_store_before_roots_were_noted_counts(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    run.execute(workers=0)
    shutil.rmtree(tmp_path / "store" / FOLDER)
    run.index.close()
    index = Index(tmp_path / "store" / "index.sqlite")
    index._change(("insert into run_file values (?)", [(str(path),)]))
    index.close()
    assert collect(Store(tmp_path / "store")) == 0


def test_verify_survives_what_it_meets(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    run.execute(workers=0)
    damage, seen = Store.damage, []

    def odd(self: Store, stage: str, address: str) -> list[str]:
        seen.append(address)
        if len(seen) == 2:
            raise StoreError("store: the network is away")
        if len(seen) == 3:
            raise RuntimeError("something nobody thought of")
        return damage(self, stage, address)

    monkeypatch.setattr(Store, "damage", odd)
    found = list(verify(run))
    assert len(seen) == 20 and [one.removed for one in found] == [False, True]
    assert run.plan().count()[found[1].stage][State.RUN] == 1
