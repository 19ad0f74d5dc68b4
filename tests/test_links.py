"""What ties a re-made artifact to the one it equals: kept by gc, told by explain, found again without an index."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from b23d.pipeline.inspection.explain import explain
from b23d.pipeline.inspection.upkeep import garbage, known_run_files, reached, verify
from b23d.pipeline.run import Run
from b23d.pipeline.store import HEAD, Store
from tests.toy import make_toy
from tests.toy_versions import bump, contents, ran


def test_two_machines_agree_whatever_they_made_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One has the old version's artifacts, the other has not: same addresses by recipe, same contents, same keys."""
    path = make_toy(tmp_path)
    Run.load(path, store=str(tmp_path / "one")).execute(workers=0)
    bump(monkeypatch, "square", 2)
    one, two = (Run.load(path, store=str(tmp_path / name)) for name in ("one", "two"))
    for run in (one, two):
        assert run.execute(workers=0).ok
    assert one.plan().nodes.keys() == two.plan().nodes.keys() and contents(one) == contents(two)
    mine = {node.address for node in one.plan().nodes.values() if node.address != node.recipe}
    assert len(mine) == 14 and all(node.address == node.recipe for node in two.plan().nodes.values())
    overrides = ["stages.add.weight=3"]
    assert Run.load(path, overrides, str(tmp_path / "one")).plan().nodes.keys() == (
        Run.load(path, overrides, str(tmp_path / "two")).plan().nodes.keys()
    )


def test_a_lost_index_loses_no_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    run.execute(workers=0)
    run.index.close()
    bump(monkeypatch, "square", 2)
    (tmp_path / "store" / "index.sqlite").unlink()
    assert ran(Run.load(path)) == {"square": 6}
    (tmp_path / "store" / "index.sqlite").unlink()
    assert Run.load(path).plan().to_run() == []


def as_older(store: Store) -> None:
    """What a store was before heads had digests and indexes knew what artifacts gave."""
    for path in Path(store.root).glob(f"*/*/*/{HEAD}"):
        group = json.loads(path.read_bytes())
        for name in ("head_sha256", "stage", "address", "key", "content"):
            del group["attributes"][name]
        path.write_text(json.dumps(group))
    (Path(store.root) / "index.sqlite").unlink()
    (Path(store.root) / "b23d-store.json").unlink()
    shutil.rmtree(Path(store.root) / ".roots")


@pytest.mark.parametrize("transient", [[], ['store.transient=["shift"]', 'outputs=["add", "square"]']])
def test_older_stores_are_read_and_reused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, transient: list[str]
) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path, transient)
    run.execute(workers=0)
    run.index.close()
    as_older(run.store)
    assert Run.load(path, transient).plan().to_run() == []
    bump(monkeypatch, "square", 2)
    assert ran(Run.load(path, transient)) == {"square": 6}
    assert list(verify(Run.load(path, transient))) == []


def test_upkeep_knows_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """gc keeps what is reused and drops what made it; verify checks it; what is reused and lost is made again."""
    path = make_toy(tmp_path)
    run = Run.load(path)
    run.execute(workers=0)
    bump(monkeypatch, "square", 2)
    dropped: list[int] = []

    def collect(*_: object) -> None:
        store = Store(tmp_path / "store")
        for item in garbage(store, reached(known_run_files(store), store)):
            store.delete(item.stage, item.address)
            dropped.append(1)

    report = Run.load(path).execute(workers=0, watch=collect)
    assert report.ok and len(report.spared) == 14 and dropped == [], "while it runs, what it may reuse is kept"
    collect()
    assert len(dropped) == 6, "the old version's own"
    assert Run.load(path).plan().to_run() == [] and list(verify(Run.load(path))) == []
    manifest = json.loads((tmp_path / "toy" / "manifest.json").read_text())
    node = Run.load(path).node("toy/s1", "shift")
    assert node.address != node.recipe and node.address in manifest["addresses"]["shift"]
    shutil.rmtree(run.store.path("shift", node.address))
    assert ran(Run.load(path)) == {"shift": 1}
    np.testing.assert_array_equal(Run.load(path).artifact("toy/s1", "shift").values, np.array([1, 4, 9, 16]) + 1.0)  # type: ignore[attr-defined]


def test_explain_says_which_link_was_cut(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = make_toy(tmp_path)
    run = Run.load(path)
    run.execute(workers=0)
    assert explain(run, "toy/s1", "shift").cuts == []
    old = run.node("toy/s1", "square").address
    bump(monkeypatch, "square", 2)
    Run.load(path).execute(workers=0)
    now = Run.load(path)
    for stage in ("shift", "add"):
        told = explain(now, now.plan().draws[0].targets[0].name if stage == "add" else "toy/s1", stage)
        assert told.state == "cached" and str(told.differences[0]) == "square.version: 1 → 2"
        assert told.cuts and all("square of toy/" in cut and "made anew" in cut for cut in told.cuts)
    assert any(old[:12] in cut for cut in explain(now, "toy/s1", "shift").cuts)
