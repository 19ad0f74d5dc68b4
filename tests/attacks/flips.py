"""One flipped bit at a time, over every file of every stage of a small real run: is it served, does verify find it?

python -m tests.attacks.flips 2000
"""

from __future__ import annotations

import random
import sys
import tempfile
from collections import Counter
from pathlib import Path

from b23d.pipeline.planning.nodes import State
from b23d.pipeline.run import Run
from tests.flipping import flips, served_wrongly, unnoticed_by_verify
from tests.small_runs import make_boxes


def flip_everything(run: Run, count: int, rng: random.Random) -> tuple[Counter[str], list[str]]:
    """Flips by stage, and what was served or passed in spite of one."""
    tried: Counter[str] = Counter()
    fell = []
    by_stage: dict[str, list[tuple[str, Path]]] = {}
    for node in run.plan().nodes.values():
        if node.state is State.CACHED:
            folder = Path(run.store.path(node.stage, node.address))
            files = [(node.address, path) for path in sorted(folder.rglob("*")) if path.is_file()]
            by_stage.setdefault(node.stage, []).extend(files)
    for stage, files in by_stage.items():
        rng.shuffle(files)
        address_of = {path: address for address, path in files}
        for path, data in flips([path for _, path in files], -(-count // len(by_stage)), rng):
            whole = path.read_bytes()
            path.write_bytes(data)
            tried[stage] += 1
            if served_wrongly(run.store, stage, address_of[path], run.config.stages[stage].gives, path):
                fell.append(f"served: {path}")
            if unnoticed_by_verify(run.store, stage, address_of[path]):
                fell.append(f"passed: {path}")
            path.write_bytes(whole)
    return tried, fell


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        made = Run.load(make_boxes(Path(name), 4))
        assert made.execute(workers=0).ok
        tried, fell = flip_everything(made, int(sys.argv[1]) if len(sys.argv) > 1 else 2000, random.Random(0))
    print(f"{sum(tried.values())} flips ({dict(tried)}): {len(fell)} served or passed", *fell[:20], sep="\n")
    sys.exit(bool(fell))
