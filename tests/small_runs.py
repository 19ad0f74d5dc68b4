"""Small real runs for tests: few views, few candidates, the embedded encoder."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import trimesh

FAST = """
[stages.normalize]
count = 256
[stages.render]
rings.count = 1
resolution = 64
[stages.extract]
encoder = "efficientnet-lite0"
[stages.optimize.discrete]
starts = 8
"""

FOLDER = """
name = "boxes"
[dataset]
kind = "folder"
root = "shapes"
[shots]
count = 2
draws = [0]
[store]
root = "{store}"
"""


def make_boxes(folder: Path, count: int = 5, extra: str = FAST) -> Path:
    """A folder data set of boxes with their eight corners annotated, and its run file; returns the run file."""
    shapes = folder / "shapes" / "box"
    shapes.mkdir(parents=True)
    entries = []
    for i in range(count):
        box = trimesh.creation.box(extents=(1.0, 0.5 + 0.1 * i, 0.8))
        mesh = box.subdivide()
        mesh.export(shapes / f"b{i}.ply")
        keypoints = [{"xyz": corner.tolist(), "semantic_id": k} for k, corner in enumerate(np.asarray(box.vertices))]
        entries.append({"model_id": f"b{i}", "keypoints": keypoints})
    (folder / "shapes" / "keypoints.json").write_text(json.dumps(entries))
    path = folder / "boxes.toml"
    path.write_text(FOLDER.format(store=folder / "store") + extra)
    return path


def b23d(*arguments: str, code: int = 0) -> str:
    """The command line in this process: what it prints. Errors are raised, not printed."""
    from typer.testing import CliRunner

    from b23d.pipeline.cli import app, plug_in

    plug_in()
    result = CliRunner().invoke(app, [*arguments], catch_exceptions=False)
    assert result.exit_code == code, result.output
    return result.output
