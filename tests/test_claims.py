"""Claims: one of several runs makes an artifact; a killed run's claim is in nobody's way; trouble means no claims."""

from __future__ import annotations

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from b23d.pipeline.claims import FOLDER, Claims
from b23d.pipeline.roots import lease, leases
from b23d.pipeline.store import Store


def test_one_of_many_takes_a_claim_and_gives_it_back(tmp_path: Path) -> None:
    store = Store(tmp_path)
    with lease(store, "1" * 32) as one, lease(store, "2" * 32) as two:
        mine, theirs = Claims(store, one), Claims(store, two)
        assert mine.take("square", "ab") and mine.take("square", "ab")
        assert not theirs.take("square", "ab") and theirs.taken_elsewhere("square", "ab")
        assert theirs.take("square", "cd") and not mine.take("square", "cd")
        mine.release("square", "ab")
        assert theirs.take("square", "ab")
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
from b23d.pipeline.claims import Claims
from b23d.pipeline.roots import lease
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
