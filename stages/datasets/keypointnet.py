"""KeypointNet (You et al., CVPR 2020) in its own layout.

```
<root>/annotations/<class>.json                          keypoints, one file a class
<root>/pcds/<class_id>/<model_id>.pcd                    clouds of 2,048 points, which point indices count
<root>/ShapeNetCore.v2.ply/<class_id>/<model_id>.ply     meshes (optional: under ShapeNet's own terms)
<root>/splits/{train,val,test}.txt                       official split, lines `<class_id>-<model_id>` (optional)
```
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

from b23d.pipeline.dataset import Shape, dataset
from b23d.stages.datasets.annotations import AnnotationFile, repeated
from b23d.stages.datasets.external import Externals, WithExternals
from b23d.stages.datasets.files import uncollected
from b23d.stages.datasets.sources import source_leaf

CLOUDS, MESHES = "pcds", "ShapeNetCore.v2.ply"


@dataset("keypointnet")
class KeypointNet(WithExternals):
    """KeypointNet's classes with their human keypoints."""

    kind: Literal["keypointnet"] = "keypointnet"
    root: Path
    """Folder with `annotations/` and `pcds/` or `ShapeNetCore.v2.ply/`."""
    classes: list[str] | None = None
    """Which classes: stems of `annotations/<class>.json`. None: all that are there."""
    geometry: Literal["auto", "mesh", "cloud"] = "auto"
    """`mesh`: ShapeNet's mesh (with the cloud for candidates where there is one); `cloud`: the cloud alone; `auto`: the
    mesh where there is one, else the cloud."""

    @uncollected()
    def shapes(self) -> list[Shape]:
        """All annotated models of the classes, sorted by name; those without geometry carry an error.

        Raises FileNotFoundError (no such root, class or annotations) and ValueError (unreadable annotations).
        """
        folder = self.root / "annotations"
        existing = sorted(path.stem for path in folder.glob("*.json"))
        if not existing:
            raise FileNotFoundError(
                f"keypointnet: expected annotations/<class>.json in {self.root}, got none; set dataset.root"
            )
        classes = existing if self.classes is None else list(dict.fromkeys(self.classes))
        if unknown := [name for name in classes if name not in existing]:
            raise FileNotFoundError(
                f"keypointnet: expected classes among {', '.join(existing)} in {folder}, got {', '.join(unknown)}; "
                "set dataset.classes"
            )
        splits, externals = self._splits(), self.externals()
        shapes = [shape for category in classes for shape in self._class(category, splits, externals)]
        return sorted(shapes, key=lambda shape: shape.name)

    def _class(self, category: str, splits: dict[str, str], externals: Externals) -> list[Shape]:
        path = self.root / "annotations" / f"{category}.json"
        annotations = AnnotationFile.read(path)
        listed: dict[str, dict[str, str]] = {}
        twice = repeated(f"{entry.get('class_id')}-{entry['model_id']}" for entry in annotations.entries)
        shapes: dict[str, Shape] = {}
        for entry in annotations.entries:
            class_id, model_id = entry.get("class_id"), entry["model_id"]
            if not isinstance(class_id, str):
                raise ValueError(
                    f"{path}: expected a string `class_id` for model {model_id}, got {class_id!r}; "
                    "mend the annotation file"
                )
            for part, suffix in ((CLOUDS, ".pcd"), (MESHES, ".ply")):
                if f"{part}/{class_id}" not in listed:
                    listed[f"{part}/{class_id}"] = _stems(self.root / part / class_id, suffix)
            name = f"{category}/{model_id}"
            cloud, mesh = listed[f"{CLOUDS}/{class_id}"].get(model_id), listed[f"{MESHES}/{class_id}"].get(model_id)
            error = self._missing(name, f"{class_id}/{model_id}", mesh, cloud)
            if f"{class_id}-{model_id}" in twice:
                error = f"{name}: expected one entry in {path}, got several; mend the annotation file"
            leaves = {"keypoints": annotations.leaf(entry, name), **externals.leaves(category, model_id)}
            if error is None:
                leaves["source"] = source_leaf(name, None if self.geometry == "cloud" else mesh, cloud)
            shapes[model_id] = Shape(model_id, category, leaves, splits.get(f"{class_id}-{model_id}"), error)
        return list(shapes.values())

    def _missing(self, name: str, file: str, mesh: str | None, cloud: str | None) -> str | None:
        """What to tell where the geometry that was asked for is not there."""
        wanted = {"mesh": [mesh], "cloud": [cloud], "auto": [mesh, cloud]}[self.geometry]
        if any(wanted):
            return None
        places = {"mesh": f"{MESHES}/{file}.ply", "cloud": f"{CLOUDS}/{file}.pcd"}
        expected = places.get(self.geometry, " or ".join(places.values()))
        remedy = "add it, or leave the model out of the annotation file"
        return f"{name}: expected {expected} in {self.root}, got no such file; {remedy}"

    def _splits(self) -> dict[str, str]:
        """`<class_id>-<model_id>` → train, val or test; empty where the data set has no splits folder."""
        splits: dict[str, str] = {}
        for split in ("train", "val", "test"):
            path = self.root / "splits" / f"{split}.txt"
            if path.is_file():
                splits.update(dict.fromkeys(path.read_text().split(), split))
        return splits


def _stems(folder: Path, suffix: str) -> dict[str, str]:
    """The paths of the folder's files with this suffix, by stem; none where there is no such folder."""
    try:
        with os.scandir(folder) as entries:
            return {entry.name[: -len(suffix)]: entry.path for entry in entries if entry.name.endswith(suffix)}
    except FileNotFoundError:
        return {}
