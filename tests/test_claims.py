"""Claims: one of several runs makes an artifact; a killed run's claim is in nobody's way; trouble means no claims."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from b23d.pipeline.cli import app
from b23d.pipeline.run import Run
from b23d.pipeline.storage.claims import FOLDER, Claims
from b23d.pipeline.storage.roots import lease, leases
from b23d.pipeline.store import Store
from tests.toy import make_toy

ROOT = Path(__file__).parents[1]


def test_one_of_many_takes_a_claim_and_gives_it_back(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with lease(store, "1" * 32) as one, lease(store, "2" * 32) as two:
        mine, theirs = Claims(store, one), Claims(store, two)
        assert mine.take("square", "ab") and mine.take("square", "ab")
        assert not theirs.take("square", "ab") and theirs.taken_elsewhere("square", "ab")
        assert theirs.take("square", "cd") and not mine.take("square", "cd")
        mine.release("square", "ab")
        assert theirs.take("square", "ab")
        assert not mine.take("square", "ab")  # all its claims are lost ones now
        mine.release_all()
        theirs.release_all()
        assert not list((tmp_path / FOLDER).iterdir())


def test_of_racing_runs_exactly_one_wins(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with lease(store, "1" * 32) as one, lease(store, "2" * 32) as two, lease(store, "3" * 32) as three:
        runs = [Claims(store, name) for name in (one, two, three)]
        with ThreadPoolExecutor(3) as pool:
            for place in range(200):
                won = list(pool.map(lambda claims, key=str(place): claims.take("square", key), runs))
                assert won.count(True) == 1, place


def test_a_killed_runs_claims_are_cleared_by_one(tmp_path: Path) -> None:
    code = f"""
import os
from b23d.pipeline.storage.claims import Claims
from b23d.pipeline.storage.roots import lease
from b23d.pipeline.store import Store
store = Store({str(tmp_path)!r})
with lease(store, "1" * 32) as name:
    claims = Claims(store, name)
    for place in range(50):
        claims.take("square", str(place))
    os._exit(9)
"""
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 9
    store = Store(tmp_path)
    assert leases(store) == []
    with lease(store, "2" * 32) as two, lease(store, "3" * 32) as three, ThreadPoolExecutor(2) as pool:
        runs = [Claims(store, two), Claims(store, three)]
        for place in range(50):
            won = list(pool.map(lambda claims, key=str(place): claims.take("square", key), runs))
            assert won.count(True) == 1, place
        for claims in runs:
            claims.release_all()
        assert not list((tmp_path / FOLDER).iterdir())


def test_trouble_with_claims_means_no_claims(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = Store(tmp_path)

    def full(*_: Any, **__: Any) -> None:
        raise OSError(28, "No space left on device")

    with lease(store, "1" * 32) as name:
        monkeypatch.setattr(Path, "hardlink_to", full)
        assert Claims(store, name).take("square", "ab")
    assert Claims(Store("memory://claims"), "any").take("square", "ab")


def test_a_lease_says_how_far_its_run_is(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with lease(store, "1" * 32, lambda: {"done": 3, "total": 8}):
        (told,) = leases(store)
        assert told["progress"] == {"done": 3, "total": 8} and told["pid"]
    assert leases(store) == []


@pytest.mark.parametrize("workers", [0, 1])
def test_two_runs_at_once_make_nothing_twice(tmp_path: Path, workers: int) -> None:
    path = make_toy(tmp_path, count=8, extra="[stages.square]\npause = 0.05\n")
    code = f"""
import json, sys
import tests.toy
from b23d.pipeline.run import Run
if __name__ == "__main__":
    report = Run.load({str(path)!r}).execute(workers={workers})
    print(json.dumps([[o.stage, o.address] for o in report.done] + [["elsewhere", str(report.elsewhere)]]))
    sys.exit(0 if report.ok else 1)
"""
    script = tmp_path / "run.py"
    script.write_text(code)
    command = [sys.executable, str(script)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    runs = [subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    told = [json.loads(run.communicate(timeout=120)[0].splitlines()[-1]) for run in runs]
    assert [run.returncode for run in runs] == [0, 0]
    made = [[tuple(key) for key in one if key[0] != "elsewhere"] for one in told]
    assert not set(made[0]) & set(made[1])
    whole = {(node.stage, node.recipe) for node in Run.load(path).plan().nodes.values()}
    assert set(made[0]) | set(made[1]) == whole


def test_status_says_who_does_what(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    store = Run.load(path).store
    idle = CliRunner().invoke(app, ["status", str(path)])
    assert idle.exit_code == 0 and "nothing is running" in idle.output
    told = {"run": "toy", "done": 3, "total": 9, "failed": 0, "seconds": 6.0, "running": ["square of toy/s1"]}
    with lease(store, "1" * 32, lambda: told):
        shown = CliRunner().invoke(app, ["status", "--store", str(store.root)])
    assert shown.exit_code == 0
    assert all(text in shown.output for text in ("3 of 9", "0:00:12", "square"))
