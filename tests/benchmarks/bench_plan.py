"""Planning 8,000 shapes × 7 addresses each (2 stages a shape, 1 stage × 5 draws), cold and with everything digested;
prints seconds."""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from b23d.pipeline.explain import explain
from b23d.pipeline.run import Run
from tests.toy import make_toy


def timed(label: str, path: Path) -> None:
    started = time.perf_counter()
    plan = Run.load(path, ["shots.draws=[0,1,2,3,4]"]).plan()
    print(f"{label:<28} {time.perf_counter() - started:.2f} s for {len(plan.nodes)} nodes")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        run_file = make_toy(Path(folder), count=8000)
        timed("plan, files never digested", run_file)
        timed("plan, again", run_file)
        started = time.perf_counter()
        explain(Run.load(run_file, ["shots.draws=[0,1,2,3,4]"]), "toy/s17", "add")
        print(f"{'explain':<28} {time.perf_counter() - started:.2f} s")
