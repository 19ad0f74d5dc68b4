"""One entry of an annotation file, made Keypoints: every value checked, in time linear in their number."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from b23d.schemas.keypoints import Keypoints
from b23d.stages.datasets.names import LONGEST

MEND = "mend the annotation file"
LARGEST = float(np.finfo(np.float64).max)


def load_keypoints(files: dict[str, bytes], values: dict[str, Any]) -> Keypoints:
    """Keypoints from one entry's `keypoints` and `symmetries`.

    Raises ValueError, naming the shape, where an entry is malformed: no list of keypoints, no finite xyz, no whole
    semantic_id, an id twice (none of KeypointNet's models has one), a negative point index, or a symmetry between
    keypoints that the entry does not have. Whether they lie on the shape is for the stage `keypoints`.
    """
    shape = values.get("shape", "the shape")
    listed = values.get("keypoints")
    if not isinstance(listed, list):
        raise ValueError(f"{shape}: expected a list of keypoints, got {type(listed).__name__}; {MEND}")
    keypoints = [_keypoint(value, f"keypoint {i} of {shape}") for i, value in enumerate(listed)]
    ids = [id for id, _, _ in keypoints]
    if twice := sorted(id for id, times in Counter(ids).items() if times > 1):
        raise ValueError(f"{shape}: expected every semantic_id once, got {twice[:5]} more than once; {MEND}")
    symmetries = values.get("symmetries") or {}
    return Keypoints(
        ids=np.array(ids, np.int32),
        positions=np.array([xyz for _, xyz, _ in keypoints], np.float64).reshape(-1, 3),
        point_indices=np.array([index for _, _, index in keypoints], np.int32),
        reflections=_groups(symmetries, "reflection", ids, shape),
        rotations=_groups(symmetries, "rotation", ids, shape),
        names=values.get("names", {}),
        annotation_file=values.get("annotation_file", ""),
    )


def named(keypoints: Any) -> dict[int, str]:
    """Semantic id → name, of an entry's keypoints that have a text as `name`; malformed ones are passed over."""
    found: dict[int, str] = {}
    for keypoint in keypoints if isinstance(keypoints, list) else []:
        name = keypoint.get("name") if isinstance(keypoint, dict) else None
        if isinstance(name, str) and name.strip() and isinstance(keypoint.get("semantic_id"), int):
            found[keypoint["semantic_id"]] = " ".join(name.split())[:LONGEST]
    return found


def _keypoint(value: Any, where: str) -> tuple[int, list[float], int]:
    """(semantic id, xyz, point index or -1)."""
    if not isinstance(value, dict):
        raise ValueError(f"{where}: expected an object, got {_short(value)}; {MEND}")
    info = value.get("pcd_info")
    index = info.get("point_index") if isinstance(info, dict) else None
    return (
        _whole(value.get("semantic_id"), where, "semantic_id"),
        _position(value.get("xyz"), where),
        -1 if index is None else _whole(index, where, "point_index"),
    )


def _whole(value: Any, where: str, what: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**31:
        raise ValueError(f"{where}: expected a whole {what} of 0 or more, got {_short(value)}; {MEND}")
    return value


def _position(value: Any, where: str) -> list[float]:
    if not isinstance(value, list) or len(value) != 3 or not all(_finite(c) for c in value):
        raise ValueError(f"{where}: expected xyz of three finite numbers, got {_short(value)}; {MEND}")
    return [float(c) for c in value]


def _finite(value: Any) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    return number and abs(value) <= LARGEST  # NaN is not


def _groups(symmetries: Any, kind: str, ids: list[int], shape: str) -> list[tuple[int, ...]]:
    """The symmetry's groups of keypoints, places in the list turned into semantic ids."""
    try:
        groups = [_group(group["kp_indexes"], ids) for group in symmetries.get(kind) or []]
    except (AttributeError, KeyError, TypeError, ValueError, IndexError) as error:
        expected = f"symmetries.{kind} to be a list of kp_indexes below {len(ids)}"
        raise ValueError(f"{shape}: expected {expected}, got {_short(symmetries)}; {MEND}") from error
    return [group for group in groups if group]


def _group(places: Any, ids: list[int]) -> tuple[int, ...]:
    for place in places:
        if not isinstance(place, int) or isinstance(place, bool) or place < 0:
            raise ValueError("not a place in the list")
    return tuple(ids[place] for place in places)


def _short(value: Any) -> str:
    """A value as a message shows it. Nesting too deep to print is said, not printed."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # ValueError: a whole number of more digits than Python prints
        return f"a {type(value).__name__} too deep or long to print"
    return text if len(text) <= 80 else f"{text[:80]}…"
