"""The annotation file while it is edited: one model's entry is replaced, all else stays as it is on disk."""

from __future__ import annotations

import copy
import fcntl
import hashlib
import json
import os
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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
    was: int | None
    """Its id in the entry that the page was given; None: it is new."""
    hit: dict[str, Any] | None
    """`xyz`, and `mesh_info` and `pcd_info` where there are; None: it has not been moved."""
    name: str | None = None
    """What people call it; None: as it was, "": nothing."""


class ConflictError(ValueError):
    """What saving would destroy; the user decides."""


class StaleError(ConflictError):
    """The annotation is not the one that the page was given: reload it, or put the page's in its place."""


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


def tag(entry: Entry | None) -> str:
    """A digest of an entry as it is on disk: what the page was given, and must still be there when it saves."""
    return hashlib.sha256(json.dumps(entry, sort_keys=True).encode()).hexdigest()[:24]


def edited_entry(entry: Entry, keypoints: list[Edited]) -> Entry:
    """The entry with these keypoints in this order. Unknown fields of the entry and of its keypoints stay.

    Symmetries name places in the list: they follow their keypoints, and lose those that are gone.
    Raises ValueError where a keypoint is meant that the entry does not have, or the result is not a valid annotation
    (an id twice, say).
    """
    entry = copy.deepcopy(entry)
    before: list[Entry] = entry.get("keypoints") or []
    places = {keypoint["semantic_id"]: place for place, keypoint in enumerate(before)}
    for keypoint in keypoints:
        if keypoint.was is not None and keypoint.was not in places and keypoint.hit is None:
            raise ValueError(f"{entry['model_id']}: expected keypoint {keypoint.was}, got none such; reload the page")
    meant = Counter(keypoint.was for keypoint in keypoints if keypoint.was is not None)
    if (twice := next((was for was, times in meant.items() if times > 1), None)) is not None:
        raise ValueError(f"{entry['model_id']}: expected keypoint {twice} once, got it twice; reload the page")
    entry["keypoints"] = [
        _edited(before[places[keypoint.was]] if keypoint.was in places else {}, keypoint) for keypoint in keypoints
    ]
    if isinstance(entry.get("symmetries"), dict):
        moved = {places[keypoint.was]: i for i, keypoint in enumerate(keypoints) if keypoint.was in places}
        entry["symmetries"] = {kind: _follow(groups, moved) for kind, groups in entry["symmetries"].items()}
    load_keypoints({}, {**entry, "shape": entry["model_id"]})
    return entry


def _edited(before: Entry, keypoint: Edited) -> Entry:
    fields = dict(before)
    if keypoint.hit is not None:
        fields = {key: value for key, value in fields.items() if key not in PLACED}
        where = {key: keypoint.hit[key] for key in PLACED[1:3] if keypoint.hit.get(key)}
        fields = {"xyz": keypoint.hit["xyz"], **fields, **where}
    if keypoint.name is not None:
        fields.pop("name", None)
        fields |= {"name": keypoint.name} if keypoint.name else {}
    return {**fields, "semantic_id": keypoint.id}


def _follow(groups: Any, moved: dict[int, int]) -> Any:
    """Groups of places renumbered; one that had company and has none left is dropped."""
    followed = []
    for group in groups or []:
        places = [moved[place] for place in group["kp_indexes"] if place in moved]
        if len(places) >= min(2, len(group["kp_indexes"])):
            followed.append({**group, "kp_indexes": places})
    return followed


def save_entry(
    path: Path, owns: Callable[[Entry], bool], given: str, edit: Callable[[Entry | None], Entry], force: bool
) -> Entry | None:
    """Put `edit(entry on disk)` in the place of the file's entry that `owns` knows: at the end if there is none, and
    nothing, where it has no keypoints. All other entries stay as they are on disk: whoever saves waits for whoever is
    saving, in this process or another.

    `given`: the tag of the entry that the page was given. Returns the entry now, None where it was removed. Raises,
    unless `force`, StaleError where the entry on disk is another, ConflictError where it would be removed; ValueError
    where the file cannot be read.
    """
    path = path.resolve()  # a link stays a link
    path.parent.mkdir(parents=True, exist_ok=True)
    with _alone(path.parent):
        disk = read_entries(path)
        theirs = find(disk, owns)
        if tag(theirs) != given and not force:
            raise StaleError(
                f"the annotation in {path.name} is not the one this page was given: somebody saved another"
            )
        new = edit(theirs)
        empty = not new["keypoints"]
        if empty and theirs is None:
            raise ValueError(f"{new['model_id']}: expected keypoints, got none; click some first")
        if empty and not force:
            raise ConflictError(
                f"no keypoint is left: saving removes the annotation of {new['model_id']} from {path.name}"
            )
        entries = [entry if entry is not theirs else new for entry in disk] + ([new] if theirs is None else [])
        _write(path, [entry for entry in entries if not (empty and entry is new)])
    return None if empty else new


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Nobody else is in here for this folder. The folder itself is locked: a library's lock would leave a file in a
    data set."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def _write(path: Path, entries: list[Entry]) -> None:
    """One entry a line, aside and then renamed: a reader sees the old file or the new one."""
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
