"""Keypoint annotations in KeypointNet's JSON form: a list with one entry a model.

```json
[{"class_id": "03001627", "model_id": "88382b…",
  "keypoints": [{"semantic_id": 0, "xyz": [0.19, 0.32, 0.10], "pcd_info": {"point_index": 9}, "name": "seat, left"}, …],
  "symmetries": {"reflection": [{"kp_indexes": [0, 1]}, …], "rotation": [{"kp_indexes": [0, 2]}, …]}}, …]
```

`kp_indexes` count places in the list `keypoints`, not semantic ids: in every annotation of the data set they stay below
the list's length, often name no id, and read as places they pair points that mirror each other. `name` is ours, and
optional.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic_core import from_json

from b23d.pipeline.dataset import Leaf
from b23d.pipeline.errors import unreadable
from b23d.stages.datasets.annotation_entry import MEND, load_keypoints, named
from b23d.stages.datasets.walking import encodable

READ = ("semantic_id", "xyz", "pcd_info")
"""What is read of a keypoint, and may change a result."""
MARKS = (b'"model_id"', b'"keypoints"')
"""What the beginning of every annotation file holds."""
BEGINNING = 1 << 16

__all__ = ["MEND", "AnnotationFile", "load_keypoints", "looks_annotated", "readable", "repeated"]


@dataclass(frozen=True)
class AnnotationFile:
    """An annotation file's entries, each a dict with at least a `model_id` string, and the file's sha256."""

    entries: list[dict[str, Any]]
    digest: str
    malformed: dict[int, str] = field(default_factory=dict)
    """Place in the list → what is wrong, of entries that are no such dict."""

    @classmethod
    def read(cls, path: Path) -> AnnotationFile:
        """Raises FileNotFoundError where there is no such regular file, OSError where it cannot be read, ValueError
        where it is not a list."""
        if not path.is_file():
            raise FileNotFoundError(f"annotations: expected a file {path}, got none; give its path")
        try:
            data = path.read_bytes()
        except OSError as error:
            raise unreadable(path, error) from error
        try:
            listed = _parse(data)
        except ValueError as error:
            raise ValueError(f"{path}: expected JSON, got {error}; {MEND}") from error
        if not isinstance(listed, list):
            raise ValueError(f"{path}: expected a list of entries, got {type(listed).__name__}; {MEND}")
        fine = {i: isinstance(e, dict) and _is_name(e.get("model_id")) for i, e in enumerate(listed)}
        malformed = {
            i: f"{path} entry {i}: expected an object with a string `model_id`, got {str(listed[i])[:80]}; {MEND}"
            for i, good in fine.items()
            if not good
        }
        return cls([listed[i] for i, good in fine.items() if good], hashlib.sha256(data).hexdigest(), malformed)

    def leaf(self, entry: dict[str, Any], name: str) -> Leaf:
        """The `keypoints` leaf of the shape called `name`. Only what `load_keypoints` reads enters its digest: a
        keypoint's colour, face or name does not."""
        keypoints = entry.get("keypoints")
        if isinstance(keypoints, list):
            keypoints = [{key: k[key] for key in READ if key in k} if isinstance(k, dict) else k for k in keypoints]
        values = {"keypoints": keypoints, "symmetries": entry.get("symmetries")}
        context: dict[str, Any] = {"annotation_file": self.digest, "shape": name}
        if names := named(entry.get("keypoints")):
            context["names"] = names
        return Leaf(load_keypoints, values, context=context)


def _is_name(value: Any) -> bool:
    return isinstance(value, str) and bool(value) and encodable(value)


def looks_annotated(path: str) -> bool:
    """Whether a JSON file begins as an annotation file does; False where it cannot be read."""
    try:
        with Path(path).open("rb") as file:
            beginning = file.read(BEGINNING)
    except OSError:
        return False
    return beginning.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"[") and all(mark in beginning for mark in MARKS)


def _parse(data: bytes) -> Any:
    """JSON, some three times as fast as the standard library: a whole data set's annotations are some 30 MB.

    NaN and infinity, which are not JSON, become texts, for `load_keypoints` to refuse in their own shape.
    """
    data = data.removeprefix(b"\xef\xbb\xbf")  # a byte order mark, as Windows' editors write it
    try:
        return from_json(data, allow_inf_nan=False)
    except ValueError as error:
        if "recursion" in str(error):
            raise ValueError("lists or objects nested too deep") from error
    try:
        return json.loads(data, parse_constant=str)
    except RecursionError as error:
        raise ValueError("lists or objects nested too deep") from error
    except json.JSONDecodeError as error:
        said = f"{error.msg[:1].lower()}{error.msg[1:]}"
        raise ValueError(f"a mistake in line {error.lineno}, column {error.colno} ({said})") from error


def readable(path: Path) -> bool:
    """Whether a file is there and holds entries, or is there and has none at all; False where something is wrong with
    it, which is told as it is read."""
    try:
        file = AnnotationFile.read(path)
    except (OSError, ValueError):
        return False
    return bool(file.entries) or not file.malformed


def repeated(names: Iterable[str]) -> set[str]:
    """The names that occur more than once."""
    seen: set[str] = set()
    return {name for name in names if name in seen or seen.add(name)}  # type: ignore[func-returns-value]
