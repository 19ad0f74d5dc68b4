"""Kills at random moments of run, gc and verify: what was stored stays whole, and the next command goes on from there.

python -m tests.attacks.kills 100     # so many of each
"""

from __future__ import annotations

import logging
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from b23d.pipeline.inspection.upkeep import garbage, known_run_files, reached, verify
from b23d.pipeline.planning.nodes import State
from b23d.pipeline.run import Run
from b23d.pipeline.store import HEAD, Store
from tests.toy import make_toy


def collect(store: Store) -> int:
    """What `b23d gc --as-written` does; how many it drops."""
    lost = garbage(store, reached(known_run_files(store), store, as_written=True))
    for item in lost:
        store.delete(item.stage, item.address)
    return len(lost)


def killed(act: Callable[[], object], after: float) -> bool:
    """Do it in a process of its own, and kill that after so many seconds; whether it was still at it."""
    child = os.fork()
    if child == 0:
        try:
            act()
        finally:
            os._exit(0)
    deadline = time.monotonic() + after
    while time.monotonic() < deadline:
        if os.waitpid(child, os.WNOHANG)[0]:
            return False
        time.sleep(0.0005)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return True


def duration(act: Callable[[], object]) -> float:
    started = time.monotonic()
    act()
    return time.monotonic() - started


def whole(store: Store) -> set[tuple[str, str]]:
    """Everything stored; fails where anything of it is damaged."""
    found = {(stage, address) for stage in store.stages() for address in store.addresses(stage)}
    for stage, address in found:
        assert store.damage(stage, address) == [], (stage, address)
    return found


def kill_runs(folder: Path, count: int, rng: random.Random) -> int:
    """Runs killed again and again until done; how many were caught at it."""
    caught = 0
    for i in range(count):
        place = folder / f"run{i}"
        place.mkdir()
        path = make_toy(place)
        usual = duration(lambda path=path: Run.load(path, store=str(path.parent / "usual")).execute(workers=0))  # type: ignore[misc]
        before: set[tuple[str, str]] = set()
        while killed(lambda path=path: Run.load(path).execute(workers=0), rng.uniform(0, usual)):  # type: ignore[misc]
            caught += 1
            now = whole(Store(place / "store"))
            assert before <= now, "what was stored stays"
            before = now
            if caught % 3 == 0:
                break
        stored = whole(Store(place / "store"))
        assert before <= stored and collect(Store(place / "store")) == 0, "a killed run's artifacts are wanted"
        report = Run.load(path).execute(workers=0)
        assert report.ok and not {(o.stage, o.address) for o in report.done} & stored
        assert len(report.done) + len(stored) == 20 and Run.load(path).plan().to_run() == []
    return caught


def kill_gc(folder: Path, count: int, rng: random.Random) -> int:
    """gc killed while it drops what an older parameter had made."""
    caught = 0
    for i in range(count):
        place = folder / f"gc{i}"
        place.mkdir()
        path = make_toy(place)
        Run.load(path, ["stages.square.power=3"]).execute(workers=0)
        Run.load(path).execute(workers=0)
        store = Store(place / "store")
        assert len(whole(store)) == 40
        caught += killed(lambda store=store: collect(store), rng.uniform(0, 0.06))  # type: ignore[misc]
        left = len(whole(store))
        plan = Run.load(path).plan()
        assert 20 <= left <= 40 and all(node.state is State.CACHED for node in plan.nodes.values())
        assert collect(store) == left - 20 and len(whole(store)) == 20
        store.drop_leftovers()
        assert not list((place / "store" / ".writing").iterdir())
    return caught


def kill_verify(folder: Path, count: int, rng: random.Random) -> int:
    """verify killed while it removes what is damaged; nothing of it is served or taken for complete afterwards."""
    caught = 0
    for i in range(count):
        place = folder / f"verify{i}"
        place.mkdir()
        path = make_toy(place)
        run = Run.load(path)
        run.execute(workers=0)
        nodes = rng.sample(list(run.plan().nodes.values()), 8)
        for node in nodes:
            head = Path(run.store.path(node.stage, node.address), HEAD)
            chunk = next(head.parent.glob("values/c/*"))
            victim = rng.choice([head, chunk])
            data = bytearray(victim.read_bytes())
            data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
            victim.write_bytes(data)
        caught += killed(lambda path=path: list(verify(Run.load(path))), rng.uniform(0, 0.25))  # type: ignore[misc]
        found = len(list(verify(Run.load(path))))
        removed = {node.recipe for node in Run.load(path).plan().to_run()}
        assert removed == {node.recipe for node in nodes} and found <= 8
        assert Run.load(path).execute(workers=0).ok and list(verify(Run.load(path))) == []
        assert len(whole(Store(place / "store"))) == 20
    return caught


if __name__ == "__main__":
    logging.disable(logging.WARNING)
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    for attack in (kill_runs, kill_gc, kill_verify):
        hits, rounds = 0, 0
        while hits < wanted:
            with tempfile.TemporaryDirectory() as name:
                hits += attack(Path(name), 10, random.Random(rounds))
            rounds += 1
        print(f"{attack.__name__}: {hits} kills in {10 * rounds} rounds, nothing lost", flush=True)
