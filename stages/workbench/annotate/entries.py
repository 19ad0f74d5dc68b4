"""The annotation file while it is edited: one model's entry is replaced, all else stays as it is on disk."""

from __future__ import annotations

import copy
import json
import os
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from b23d.stages.datasets.annotations import AnnotationFile, load_keypoints

Entry = dict[str, Any]
PLACED = ("xyz", "mesh_info", "pcd_info", "rgb")
"""Fields that say where a keypoint is (its colour is that of its place): they do not outlive a move."""


@dataclass(frozen=True)
class Edited:
    """A keypoint as the page has it."""

    id: int
    place: int | None
    """Where it stood in the entry's list when the entry was loaded; None: it is new."""
    hit: dict[str, Any] | None
    """`xyz`, and `mesh_info` and `pcd_info` where there are; None: it has not been moved."""


class ConflictError(ValueError):
    """What saving would destroy; the user decides."""


def read_entries(path: Path) -> list[Entry]:
    """The file's entries with everything in them; none where there is no file. Raises ValueError as
    `AnnotationFile.read`."""
    if not path.exists():
        return []
    AnnotationFile.read(path)
    entries: list[Entry] = json.loads(path.read_bytes())
    return entries


def find(entries: list[Entry], owns: Callable[[Entry], bool]) -> Entry | None:
    return next((entry for entry in entries if owns(entry)), None)


def edited_entry(entry: Entry, keypoints: list[Edited]) -> Entry:
    """The entry with these keypoints in this order. Unknown fields of the entry and of its keypoints stay.

    Symmetries name places in the list: they follow their keypoints, and lose those that are gone.
    Raises ValueError where the result is not a valid annotation (an id twice, say).
    """
    entry = copy.deepcopy(entry)
    before = entry.get("keypoints") or []
    after: list[Entry] = []
    for keypoint in keypoints:
        fields = dict(before[keypoint.place]) if keypoint.place is not None else {}
        if keypoint.hit is not None:
            fields = {key: value for key, value in fields.items() if key not in PLACED}
            fields = {
                "xyz": keypoint.hit["xyz"],
                **fields,
                **{k: keypoint.hit[k] for k in PLACED[1:3] if keypoint.hit.get(k)},
            }
        after.append({**fields, "semantic_id": keypoint.id})
    entry["keypoints"] = after
    if isinstance(entry.get("symmetries"), dict):
        moved = {keypoint.place: place for place, keypoint in enumerate(keypoints) if keypoint.place is not None}
        entry["symmetries"] = {kind: _follow(groups, moved) for kind, groups in entry["symmetries"].items()}
    load_keypoints({}, {**entry, "shape": entry["model_id"]})
    return entry


def _follow(groups: Any, moved: dict[int, int]) -> Any:
    """Groups of places renumbered; one that had company and has none left is dropped."""
    followed = []
    for group in groups or []:
        places = [moved[place] for place in group["kp_indexes"] if place in moved]
        if len(places) >= min(2, len(group["kp_indexes"])):
            followed.append({**group, "kp_indexes": places})
    return followed


def save_entry(
    path: Path, owns: Callable[[Entry], bool], loaded: list[Entry], new: Entry, force: bool
) -> tuple[list[Entry], str]:
    """Put `new` in the file's entry that `owns` knows (at the end if none; without keypoints, that entry is removed).

    `loaded` is the file as it was read: what others changed since in other models is kept. Returns the file's entries
    now, and what to tell the user of others' changes. Raises ConflictError, unless `force`, where this model's own
    entry changed on disk, or would be removed; ValueError where the file cannot be read.
    """
    disk = read_entries(path)
    mine, theirs = find(loaded, owns), find(disk, owns)
    if mine != theirs and not force:
        what = "removed" if theirs is None else "added" if mine is None else "changed"
        model = new["model_id"]
        raise ConflictError(
            f"the annotation of {model} was {what} on disk since it was loaded; saving puts this page's in its place"
        )
    empty = not new["keypoints"]
    if empty and theirs is None:
        raise ValueError(f"{new['model_id']}: expected keypoints, got none; click some first")
    if empty and not force:
        raise ConflictError(f"no keypoint is left: saving removes the annotation of {new['model_id']} from {path.name}")
    if theirs is not None and mine is not None:
        new = {**theirs, **new}
    others = sum(entry not in loaded for entry in disk if not owns(entry))
    gone = sum(entry not in disk for entry in loaded if not owns(entry))
    entries = [entry if entry is not theirs else new for entry in disk] + ([new] if theirs is None else [])
    entries = [entry for entry in entries if not (empty and entry is new)]
    _write(path, entries)
    merged = (
        f"others changed {max(others, gone)} more models in it meanwhile: their work is kept" if others or gone else ""
    )
    return entries, merged


def _write(path: Path, entries: list[Entry]) -> None:
    """One entry a line, aside and then renamed: a reader sees the old file or the new one."""
    path = path.resolve()  # a link stays a link
    path.parent.mkdir(parents=True, exist_ok=True)
    text = "[\n" + ",\n".join(json.dumps(entry) for entry in entries) + "\n]\n" if entries else "[]\n"
    mode = path.stat().st_mode & 0o777 if path.exists() else 0o666 & ~_umask()
    handle, aside = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "w") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        Path(aside).chmod(mode)
        Path(aside).replace(path)
    except BaseException:
        Path(aside).unlink(missing_ok=True)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
