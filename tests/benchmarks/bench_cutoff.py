"""Early cut-off on a folder of real meshes: a version that changes nothing, a file saved again, `watertight`, a mended
file. Prints tasks done and spared, and CPU seconds.

    python tests/benchmarks/bench_cutoff.py FOLDER_OF_MESHES
"""

from __future__ import annotations

import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from b23d.pipeline.run import Run
from b23d.pipeline.stage import STAGES

RUN = """
name = "cutoff"
outputs = ["backproject", "geodesic"]
[dataset]
kind = "folder"
root = "shapes"
[stages.normalize]
count = 512
[stages.render]
resolution = 128
[stages.render.rings]
count = 1
[stages.extract]
encoder = "efficientnet-lite0"
"""


def execute(label: str, path: Path, *overrides: str) -> None:
    planned = Run.load(path, overrides).plan()
    sure, behind = len(planned.to_run()) - planned.behind(), planned.behind()
    started = time.process_time()
    report = Run.load(path, overrides).execute(workers=0)
    seconds = time.process_time() - started
    done = dict(Counter(outcome.stage for outcome in report.done))
    saved = sum(outcome.seconds for outcome in report.spared)
    print(
        f"{label:<32} planned {sure}, at most {behind} behind; done {done}, {len(report.spared)} spared "
        f"({saved:.1f} s), {len(report.failures)} failed; {seconds:.1f} CPU s",
        flush=True,
    )


def say_again(path: Path) -> None:
    """The same mesh with a comment, and its numbers spelt otherwise."""
    text = re.sub(r"(?m)^(v .*\.\d+)\s*$", r"\g<1>0", path.read_text())
    path.write_text(f"# saved again\n{text}")


def without_a_face(path: Path) -> None:
    lines = path.read_text().splitlines()
    last = max(i for i, line in enumerate(lines) if line.startswith("f "))
    path.write_text("\n".join([*lines[:last], *lines[last + 1 :]]) + "\n")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(sys.argv[1], folder / "shapes" / "class")
        meshes = sorted((folder / "shapes" / "class").glob("*.obj"))
        run_file = folder / "cutoff.toml"
        run_file.write_text(RUN)
        execute("first", run_file)
        normalize = STAGES["normalize"]
        STAGES["normalize"] = replace(normalize, version=normalize.version + 1)
        execute("a version that changes nothing", run_file)
        say_again(meshes[0])
        execute("a mesh saved again", run_file)
        without_a_face(meshes[1])
        execute("one mesh without one face", run_file)
        execute("watertight = true", run_file, "stages.normalize.watertight=true")
        execute("and nothing again", run_file, "stages.normalize.watertight=true")
