"""One shape being annotated: what the page is told, where clicks land, what is saved."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from b23d.pipeline.dataset import Dataset, Leaf, Shape
from b23d.pipeline.planning.hinting import hint
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.shape import Source
from b23d.schemas.wording import counted
from b23d.stages.datasets.names import keypoint_names
from b23d.stages.workbench.annotate.entries import (
    ConflictError,
    Edited,
    Entry,
    edited_entry,
    find,
    read_entries,
    save_entry,
    tag,
)
from b23d.stages.workbench.annotate.geometry import Pickable
from b23d.stages.workbench.pictures.palette import IDS, id_color

REFERENCES = 200
"""Annotated shapes of the class that the page offers beside, at most."""


class Session:
    """One shape that pages show. It holds nothing that a save changes: any number of pages and threads may share it."""

    def __init__(
        self,
        dataset: Dataset,
        shapes: list[Shape],
        name: str,
        keypoints: Path | None = None,
        standing: Callable[[str, Source], Source] = lambda name, source: source,
    ) -> None:
        """`keypoints`: the file to write to; None: the data set's own. `standing`: a shape's source as it is to be
        shown, by its up axis. Raises KeyError (no such shape), ValueError (the data set's annotations must not be
        written, or the shape or its annotation is broken), FileNotFoundError."""
        self.standing = standing
        self.shape = find_shape(shapes, name)
        own = dataset.annotation_file(self.shape.category)
        self.path = keypoints if keypoints is not None else writable_file(dataset, self.shape.category)
        if self.shape.error is not None:
            raise ValueError(self.shape.error)
        self.own = keypoints is None or (own is not None and self.path.resolve() == own.resolve())
        others = (s for s in shapes if s.category == self.shape.category and s.name != name and s.error is None)
        self.peers = [s for s in others if "keypoints" in s.leaves]
        self.class_ids = dataset.class_ids(self.shape.category)
        self.alone = sum(s.id == self.shape.id for s in shapes) == 1
        self.first = self._first_entry(dataset)
        read_entries(self.path)  # better told now than when the page asks
        self.pickable = Pickable.load(standing(name, _read(self.shape.leaves["source"])))

    def page(self) -> dict[str, Any]:
        """All the page needs: the shape, its keypoints, the class's ids, which shapes may stand beside."""
        on_disk = find(read_entries(self.path), self._owns)
        counts: Counter[int] = Counter()
        called = keypoint_names(self.peers).get(self.shape.category, {})
        names = []
        for peer, keypoints in self._annotated():
            counts.update(keypoints.ids.tolist())
            names.append((len(keypoints.ids), peer.name))
        best = max(names, key=lambda pair: pair[0])[1] if names else None  # the fullest annotation shows most ids
        return {
            "name": self.shape.name,
            "file": str(self.path),
            "shape": self._drawing(self.pickable),
            "given": tag(on_disk),
            "keypoints": self._keypoints(on_disk or self.first),
            "ids": [{"id": i, "count": n, "name": called.get(i, "")} for i, n in sorted(counts.items())],
            "peers": len(names),
            "references": sorted(name for _, name in names)[:REFERENCES],
            "reference": best,
            "colors": [id_color(i) for i in range(IDS)],
        }

    def reference(self, name: str) -> dict[str, Any]:
        """A shape of the class with its keypoints. Raises KeyError where it is none of them, ValueError where it is
        broken."""
        peer = find_shape(self.peers, name)
        pickable = Pickable.load(self.standing(name, _read(peer.leaves["source"])))
        keypoints = _read(peer.leaves["keypoints"])
        unit = pickable.unit(keypoints.positions)
        ids, places = keypoints.ids.tolist(), keypoints.positions.tolist()
        listed = [
            {"id": i, "unit": at, "at": {"xyz": xyz}, "name": keypoints.names.get(i, "")}
            for i, at, xyz in zip(ids, unit.tolist(), places, strict=True)
        ]
        return {"name": name, "shape": self._drawing(pickable), "keypoints": listed}

    def hit(
        self, origin: list[float], direction: list[float], within: float = 0.0, extremity: bool = False
    ) -> dict[str, Any] | None:
        """Where a ray from the viewer (unit frame) lands, as `Pickable.hit`."""
        found = self.pickable.hit(origin, direction, within, extremity)
        return None if found is None else asdict(found)

    def save(self, keypoints: list[dict[str, Any]], given: str, force: bool = False) -> dict[str, Any]:
        """Write the shape's entry. `given`: the tag of what the page was given. Raises StaleError or ConflictError
        where the user must decide first, ValueError where it is not valid."""
        edited = [Edited(k["id"], k["was"], k["hit"], k.get("name")) for k in keypoints]
        entry = save_entry(self.path, self._owns, given, lambda e: edited_entry(e or self.first, edited), force)
        many = counted(len(keypoints), "keypoint")
        return {"message": f"saved {many} to {self.path}", "given": tag(entry)}

    def _owns(self, entry: Entry) -> bool:
        """As the folder data set reads it: the class id decides where shapes of several classes share an id."""
        return entry.get("model_id") == self.shape.id and (self.alone or entry.get("class_id") in self.class_ids)

    def _first_entry(self, dataset: Dataset) -> Entry:
        """What the data set knows of a shape that the file to write to does not have yet."""
        known = find(_entries(dataset, self.shape.category), self._owns)
        if known is not None:
            return known
        entry: Entry = {"class_id": self.shape.category, "model_id": self.shape.id, "keypoints": []}
        if "keypoints" in self.shape.leaves:
            keypoints = _read(self.shape.leaves["keypoints"])
            ids = keypoints.ids.tolist()
            entry["keypoints"] = [
                {"xyz": at, "semantic_id": i} for i, at in zip(ids, keypoints.positions.tolist(), strict=True)
            ]
            groups = {"reflection": keypoints.reflections, "rotation": keypoints.rotations}
            entry["symmetries"] = {
                kind: [{"kp_indexes": [ids.index(i) for i in group]} for group in found]
                for kind, found in groups.items()
            }
        return entry

    def _keypoints(self, entry: Entry) -> list[dict[str, Any]]:
        keypoints = entry.get("keypoints") or []
        unit = self.pickable.unit(np.array([k["xyz"] for k in keypoints], np.float64).reshape(-1, 3)).tolist()
        fields = ("xyz", "mesh_info", "pcd_info")
        return [
            {"id": k["semantic_id"], "unit": unit[i], "at": {f: k.get(f) for f in fields}, "name": k.get("name") or ""}
            for i, k in enumerate(keypoints)
        ]

    def _annotated(self) -> Iterator[tuple[Shape, Keypoints]]:
        for peer in self.peers:
            try:
                yield peer, _read(peer.leaves["keypoints"])
            except (ValueError, OSError):
                continue  # another shape's broken annotation is told by `b23d run`

    def _drawing(self, pickable: Pickable) -> dict[str, Any]:
        vertices, faces, colors = pickable.drawing()
        return {
            "kind": pickable.drawn.kind,
            "vertices": _pack(vertices.astype("<f4")),
            "faces": _pack(faces.astype("<i4")),
            "colors": None if colors is None else _pack(colors.astype(np.uint8)),
        }


def find_shape(shapes: list[Shape], name: str) -> Shape:
    """Raises KeyError where none is called so."""
    found = next((shape for shape in shapes if shape.name == name), None)
    if found is not None:
        return found
    near = hint(name, [shape.name for shape in shapes])
    raise KeyError(f"shape: expected one of the data set's, got {name!r}; {near}")


def writable_file(dataset: Dataset, category: str) -> Path:
    """The data set's own annotation file of a class. Raises ValueError where it is not ours to change."""
    path, kept = dataset.annotation_file(category), dataset.annotations_kept()
    if path is None or kept:
        raise ValueError(
            f"annotate: expected a data set with an annotation file to write to, got {dataset.kind}: {kept}; "
            "give another file with --keypoints FILE"
        )
    return path


def _entries(dataset: Dataset, category: str) -> list[Entry]:
    """Entries of the data set's own annotation file, whole; none where there is none."""
    path = dataset.annotation_file(category)
    return [] if path is None else read_entries(path)


def _read(leaf: Leaf) -> Any:
    artifact = leaf.read()
    assert isinstance(artifact, Source | Keypoints)
    return artifact


def _pack(values: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(values).tobytes()).decode()


__all__ = ["ConflictError", "Session", "find_shape", "writable_file"]
