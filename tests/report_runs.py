"""A small real run to report on: boxes as meshes, egg-shaped clouds, a broken file, a class with too few shots."""

from __future__ import annotations

import json
import tempfile
from functools import cache
from pathlib import Path

import numpy as np
import trimesh

from b23d.pipeline.run import Run

RUN = """
name = "mixed"
[dataset]
kind = "folder"
root = "shapes"
[shots]
count = 2
draws = [0, 1]
[stages.normalize]
count = 256
[stages.render]
rings = {{count = 1}}
resolution = 64
[stages.extract]
encoder = "efficientnet-lite0"
[stages.optimize.discrete]
starts = 8
[store]
root = "{store}"
transient = ["render", "extract"]
"""
AXES = np.array([[0.5, 0, 0], [-0.5, 0, 0], [0, 0.4, 0], [0, -0.4, 0], [0, 0, 0.3], [0, 0, -0.3]])


_FOLDER = tempfile.TemporaryDirectory(prefix="b23d-report-")  # removed when the tests end


@cache
def mixed() -> Run:
    """That run, made once for all tests; they leave it as it is."""
    return make_mixed(Path(_FOLDER.name))


def make_mixed(folder: Path) -> Run:
    """Its data set and run file in `folder`, run to the end."""
    entries = []
    for i in range(4):
        box = trimesh.creation.box(extents=(1.0, 0.5 + 0.1 * i, 0.8))
        _put(folder / "shapes" / "box" / f"b{i}.ply", trimesh.exchange.ply.export_ply(box))
        entries.append(_entry(f"b{i}", np.asarray(box.vertices)))
    for i in range(3):
        egg = trimesh.creation.icosphere(subdivisions=3).vertices * [0.5, 0.3 + 0.05 * i, 0.3]
        _put(folder / "shapes" / "egg" / f"e{i}.xyz", "\n".join(f"{x} {y} {z}" for x, y, z in egg).encode())
        entries.append(_entry(f"e{i}", AXES * [1, (0.3 + 0.05 * i) / 0.4, 1]))
    _put(
        folder / "shapes" / "lonely" / "l0.ply",
        trimesh.exchange.ply.export_ply(trimesh.creation.icosphere(subdivisions=2)),
    )
    entries.append(_entry("l0", np.sign(AXES)))
    _put(folder / "shapes" / "box" / "broken.ply", b"ply\nformat ascii 1.0\nend_header\n")
    (folder / "shapes" / "keypoints.json").write_text(json.dumps(entries))
    path = folder / "mixed.toml"
    path.write_text(RUN.format(store=folder / "store"))
    run = Run.load(path, ["stages.learn.ridge=0.5"])
    report = run.execute(workers=0)
    assert {failure.shape for failure in report.failures} == {"box/broken", "class lonely"}, report.failures
    return run


def _entry(model: str, corners: np.ndarray) -> dict[str, object]:
    return {
        "model_id": model,
        "keypoints": [{"xyz": corner.tolist(), "semantic_id": 2 * k} for k, corner in enumerate(corners)],
    }


def _put(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
