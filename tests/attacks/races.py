"""Two processes at once: two writers of one artifact, two runs on one store, a run beside gc.

python -m tests.attacks.races 70     # so many of each
"""

from __future__ import annotations

import logging
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

from b23d.pipeline.run import Run
from b23d.pipeline.store import Store
from tests.attacks.kills import collect, whole
from tests.toy import Numbers, make_toy

ADDRESS = "ab" + "0" * 62


def at_once(*acts: Callable[[], bool]) -> list[bool]:
    """Do them in processes of their own, at the same time; whether each ended well."""
    read, write = os.pipe()
    children = []
    for act in acts:
        child = os.fork()
        if child == 0:
            os.close(write)
            os.read(read, 1)  # until the parent lets all go
            code = 1
            try:
                code = 0 if act() else 1
            finally:
                os._exit(code)
        children.append(child)
    os.close(read)
    os.close(write)
    return [os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0 for child in children]


def race_writers(folder: Path, count: int) -> int:
    """Both publish one address, over nothing or over something broken."""
    store = Store(folder)
    artifact = Numbers(values=np.arange(5.0), grid=np.ones((3, 5), np.float32))
    for i in range(count):
        if i % 2:
            Path(store.path("square", ADDRESS), "values").mkdir(parents=True)
        acts = [lambda by=by: bool(store.write("square", ADDRESS, artifact, {"by": by})) for by in "ab"]  # type: ignore[misc]
        assert at_once(*acts) == [True, True]
        assert whole(store) == {("square", ADDRESS)} and not list((folder / ".writing").iterdir())
        store.delete("square", ADDRESS)
    return count


def race_runs(folder: Path, count: int) -> int:
    """Two runs of one file, both from nothing."""
    for i in range(count):
        place = folder / f"runs{i}"
        place.mkdir()
        path = make_toy(place)
        acts = [lambda path=path: Run.load(path).execute(workers=0).ok] * 2  # type: ignore[misc]
        assert at_once(*acts) == [True, True], place
        assert len(whole(Store(place / "store"))) == 20 and Run.load(path).plan().to_run() == []
    return count


def race_gc(folder: Path, count: int) -> int:
    """A run from nothing, with --set, beside gc after gc."""
    for i in range(count):
        place = folder / f"gc{i}"
        place.mkdir()
        path = make_toy(place)
        overrides = ["stages.shift.by=3"] * (i % 2)
        Run.load(path, ["stages.square.power=5"]).execute(workers=0)

        def gc(place: Path = place) -> bool:
            for _ in range(5):
                collect(Store(place / "store"))
            return True

        run = lambda path=path, overrides=overrides: Run.load(path, overrides).execute(workers=0).ok  # type: ignore[misc] # noqa: E731
        assert at_once(run, gc) == [True, True], place
        assert Run.load(path, overrides).execute(workers=0).ok, "what gc has dropped as unwanted can be made again"
        whole(Store(place / "store"))
    return count


if __name__ == "__main__":
    logging.disable(logging.WARNING)
    wanted = int(sys.argv[1]) if len(sys.argv) > 1 else 70
    for attack in (race_writers, race_runs, race_gc):
        with tempfile.TemporaryDirectory() as name:
            print(f"{attack.__name__}: {attack(Path(name), wanted)} races, nothing lost", flush=True)
