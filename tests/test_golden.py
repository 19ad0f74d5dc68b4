"""Golden outputs guard (stage, version): what a stage makes of a fixed small input changes only together with its
version.

Where a change is meant: raise the stage's version, then `python -m tests.test_golden` writes tests/golden.json anew.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from b23d.pipeline.run import Run
from b23d.schemas.artifact import Artifact
from tests.small_runs import FAST

GOLDEN = Path(__file__).with_name("golden.json")
RUN = """
name = "golden"
outputs = {outputs}
[dataset]
kind = "procedural"
classes = ["chair"]
count = 4
[shots]
count = 2
draws = [0]
[store]
root = "{store}"
[feeds]
{feeds}
"""
WAYS: dict[str, tuple[list[str], dict[str, str], list[str]]] = {
    "main": (["reweight", "optimize", "score", "score_parts"], {}, []),
    "discrete": (["optimize"], {}, ["stages.optimize.method=discrete"]),
    "heat": (["geodesic"], {}, ["stages.geodesic.method=heat"]),
    "hks": (["backproject"], {"backproject": "describe"}, ["stages.describe.descriptor=hks"]),
    "shot": (["backproject"], {"backproject": "describe"}, ["stages.describe.descriptor=shot"]),
    "farthest": (["optimize"], {"optimize": "detect"}, []),
    "auto": (["normalize"], {}, ["dataset.up=auto"]),
    "head": (["optimize"], {"optimize": "apply_head"}, []),
}
"""Way → outputs, feeds, overrides."""


def fingerprint(artifact: Artifact) -> dict[str, list[Any]]:
    """Array → its shape, and mean and standard deviation of its finite values."""
    found: dict[str, list[Any]] = {}
    for name, array in artifact.present_arrays().items():
        values = np.asarray(array, np.float64)
        values = values[np.isfinite(values)]
        figures = [float(f"{x:.6g}") for x in (values.mean(), values.std())] if values.size else []
        found[name] = [list(array.shape), *figures]
    return found


def outputs_of(way: str, folder: Path) -> dict[str, Any]:
    """Stage → {"version", "arrays"} of what a run makes of its first target (its first shape, where it has no
    shots)."""
    outputs, feeds, overrides = WAYS[way]
    path = folder / f"{way}.toml"
    lines = "\n".join(f'{argument} = "{stage}"' for argument, stage in feeds.items())
    path.write_text(RUN.format(outputs=json.dumps(outputs), store=folder / "store", feeds=lines) + FAST)
    run = Run.load(path, overrides)
    assert run.execute(workers=0).ok
    plan = run.plan()
    target = (plan.draws[0].targets if plan.draws else run.shapes)[0].name
    found = {}
    for name in run.config.stages:
        node = plan.by_shape.get((name, target, None)) or plan.by_shape.get((name, target, 0))
        if node is not None:
            artifact = run.store.read(node.stage, node.address, run.config.stages[name].gives)
            found[name] = {"version": run.config.stages[name].version, "arrays": fingerprint(artifact)}
    return found


@pytest.mark.parametrize("way", WAYS)
def test_outputs_change_only_with_the_stages_version(way: str, tmp_path: Path) -> None:
    golden = json.loads(GOLDEN.read_text())[way]
    for stage, now in outputs_of(way, tmp_path).items():
        wrong = f"{stage} {now['version']}: its output is not what golden.json has"
        advice = f"{wrong}; raise its version, then python -m tests.test_golden"
        before = golden[stage]
        assert now["version"] == before["version"], (
            f"{stage}: version is not golden.json's; python -m tests.test_golden"
        )
        assert now["arrays"].keys() == before["arrays"].keys(), advice
        for name, (shape, *figures) in now["arrays"].items():
            assert shape == before["arrays"][name][0], f"{advice} ({name})"
            np.testing.assert_allclose(
                figures, before["arrays"][name][1:], rtol=5e-3, atol=1e-4, err_msg=f"{advice} ({name})"
            )


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        GOLDEN.write_text(json.dumps({way: outputs_of(way, Path(folder)) for way in WAYS}, indent=1) + "\n")
    sys.stdout.write(f"wrote {GOLDEN}\n")
