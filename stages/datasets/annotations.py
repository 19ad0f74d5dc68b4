"""Keypoint annotations in KeypointNet's JSON form: a list with one entry a model.

```json
[{"class_id": "03001627", "model_id": "88382b…",
  "keypoints": [{"semantic_id": 0, "xyz": [0.19, 0.32, 0.10], "pcd_info": {"point_index": 1090}}, …],
  "symmetries": {"reflection": [{"kp_indexes": [0, 1]}, …], "rotation": [{"kp_indexes": [0, 2]}, …]}}, …]
```

`kp_indexes` count places in the list `keypoints`, not semantic ids: in every annotation of the data set they stay below
the list's length, often name no id, and read as places they pair points that mirror each other.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic_core import from_json

from b23d.pipeline.dataset import Leaf
from b23d.schemas.keypoints import Keypoints

MEND = "mend the annotation file"
LARGEST = float(np.finfo(np.float64).max)
READ = ("semantic_id", "xyz", "pcd_info")
"""What is read of a keypoint."""


@dataclass(frozen=True)
class AnnotationFile:
    """An annotation file's entries, each a dict with at least a `model_id` string, and the file's sha256."""

    entries: list[dict[str, Any]]
    digest: str

    @classmethod
    def read(cls, path: Path) -> AnnotationFile:
        """Raises FileNotFoundError, and ValueError where the file is not a list of entries with a `model_id` each."""
        if not path.is_file():
            raise FileNotFoundError(f"annotations: expected a file {path}, got none; give its path")
        data = path.read_bytes()
        try:
            entries = _parse(data)
        except ValueError as error:
            raise ValueError(f"{path}: expected JSON, got {error}; {MEND}") from error
        if not isinstance(entries, list):
            raise ValueError(f"{path}: expected a list of entries, got {type(entries).__name__}; {MEND}")
        for i, entry in enumerate(entries):
            if not isinstance(entry, dict) or not isinstance(entry.get("model_id"), str):
                raise ValueError(
                    f"{path}: expected entry {i} to be an object with a string `model_id`, got {str(entry)[:80]}; "
                    f"{MEND}"
                )
        return cls(entries, hashlib.sha256(data).hexdigest())

    def leaf(self, entry: dict[str, Any], name: str) -> Leaf:
        """The `keypoints` leaf of the shape called `name`. Only what `load_keypoints` reads enters its digest: a
        keypoint's colour or face does not."""
        keypoints = entry.get("keypoints")
        if isinstance(keypoints, list):
            keypoints = [{key: k[key] for key in READ if key in k} if isinstance(k, dict) else k for k in keypoints]
        values = {"keypoints": keypoints, "symmetries": entry.get("symmetries")}
        return Leaf(load_keypoints, values, context={"annotation_file": self.digest, "shape": name})


def _parse(data: bytes) -> Any:
    """JSON, some three times as fast as the standard library: a whole data set's annotations are some 30 MB.

    NaN and infinity, which are not JSON, become texts, for `load_keypoints` to refuse in their own shape.
    """
    try:
        return from_json(data, allow_inf_nan=False)
    except ValueError:
        return json.loads(data, parse_constant=str)


def repeated(names: Iterable[str]) -> set[str]:
    """The names that occur more than once."""
    seen: set[str] = set()
    return {name for name in names if name in seen or seen.add(name)}  # type: ignore[func-returns-value]


def load_keypoints(files: dict[str, bytes], values: dict[str, Any]) -> Keypoints:
    """Keypoints from one entry's `keypoints` and `symmetries`.

    Raises ValueError, naming the shape, where an entry is malformed: no list of keypoints, no finite xyz, no whole
    semantic_id, an id twice (none of KeypointNet's models has one), a negative point index, or a symmetry between
    keypoints that the entry does not have. That a point index lies within the cloud is for `check_keypoints`.
    """
    shape = values.get("shape", "the shape")
    keypoints = values.get("keypoints")
    if not isinstance(keypoints, list):
        raise ValueError(f"{shape}: expected a list of keypoints, got {type(keypoints).__name__}; {MEND}")
    ids: list[int] = []
    positions: list[list[float]] = []
    indices: list[int] = []
    for i, keypoint in enumerate(keypoints):
        if not isinstance(keypoint, dict):
            raise ValueError(f"keypoint {i} of {shape}: expected an object, got {str(keypoint)[:80]}; {MEND}")
        ids.append(_whole(keypoint.get("semantic_id"), f"keypoint {i} of {shape}", "semantic_id"))
        positions.append(_position(keypoint.get("xyz"), f"keypoint {i} of {shape}"))
        info = keypoint.get("pcd_info")
        index = info.get("point_index") if isinstance(info, dict) else None
        indices.append(-1 if index is None else _whole(index, f"keypoint {i} of {shape}", "point_index"))
    if twice := {i for i in ids if ids.count(i) > 1}:
        raise ValueError(f"{shape}: expected every semantic_id once, got {sorted(twice)} more than once; {MEND}")
    symmetries = values.get("symmetries") or {}
    return Keypoints(
        ids=np.array(ids, np.int32),
        positions=np.array(positions, np.float64).reshape(-1, 3),
        point_indices=np.array(indices, np.int32),
        reflections=_groups(symmetries, "reflection", ids, shape),
        rotations=_groups(symmetries, "rotation", ids, shape),
        annotation_file=values.get("annotation_file", ""),
    )


def _whole(value: Any, where: str, what: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**31:
        raise ValueError(f"{where}: expected a whole {what} of 0 or more, got {value!r}; {MEND}")
    return value


def _position(value: Any, where: str) -> list[float]:
    fine = (
        isinstance(value, list)
        and len(value) == 3
        and all(isinstance(c, int | float) and not isinstance(c, bool) for c in value)
    )
    if not fine or any(not abs(c) <= LARGEST for c in value):  # NaN is not
        raise ValueError(f"{where}: expected xyz of three finite numbers, got {str(value)[:80]}; {MEND}")
    return [float(c) for c in value]


def _groups(symmetries: Any, kind: str, ids: list[int], shape: str) -> list[tuple[int, ...]]:
    """The symmetry's groups of keypoints, places in the list turned into semantic ids."""
    try:
        groups = [tuple(group["kp_indexes"]) for group in symmetries.get(kind) or []]
        if any(not isinstance(i, int) or i < 0 for group in groups for i in group):
            raise ValueError("negative")
        return [tuple(ids[i] for i in group) for group in groups if group]
    except (AttributeError, KeyError, TypeError, ValueError, IndexError) as error:
        raise ValueError(
            f"{shape}: expected symmetries.{kind} to be a list of kp_indexes below {len(ids)}, "
            f"got {str(symmetries)[:120]}; {MEND}"
        ) from error
