"""Small data sets written to a folder, and their leaves read as the engine reads them."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

from b23d.pipeline.dataset import Leaf, Shape

PCD = b"VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
PCD += b"WIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA ascii\n0 0 0\n1 1 1\n"
PLY = b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
PLY_POINTS = PLY + b"end_header\n0 0 0\n1 0 0\n0 1 0\n"
PLY_MESH = PLY + b"element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


def entry(model: str, class_id: str | None = "01", **more: Any) -> dict[str, Any]:
    keypoints = [
        {"semantic_id": 4, "xyz": [0, 0, 0], "pcd_info": {"point_index": 0}},
        {"semantic_id": 7, "xyz": [1, 1, 1.5]},
    ]
    symmetries = {"reflection": [{"kp_indexes": [0, 1]}], "rotation": []}
    made = {"class_id": class_id, "model_id": model, "keypoints": keypoints, "symmetries": symmetries, **more}
    return {key: value for key, value in made.items() if value is not None}


def put(root: Path, files: dict[str, bytes | str | list[Any]]) -> Path:
    for name, data in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(
            data if isinstance(data, bytes) else (data if isinstance(data, str) else json.dumps(data)).encode()
        )
    return root


def read(leaf: Leaf) -> Any:
    """As the engine does it on a worker."""
    leaf = pickle.loads(pickle.dumps(leaf))
    return leaf.load({name: path.read_bytes() for name, path in leaf.files.items()}, {**leaf.values, **leaf.context})


def by_name(shapes: list[Shape]) -> dict[str, Shape]:
    assert [s.name for s in shapes] == sorted({s.name for s in shapes}), "sorted, unique"
    return {shape.name: shape for shape in shapes}
