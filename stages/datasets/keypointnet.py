"""KeypointNet (You et al., CVPR 2020) in its own layout.

```
<root>/annotations/<class>.json                          keypoints, one file a class
<root>/pcds/<class_id>/<model_id>.pcd                    clouds of 2,048 points, which point indices count
<root>/ShapeNetCore.v2.ply/<class_id>/<model_id>.ply     meshes (optional: under ShapeNet's own terms)
<root>/splits/{train,val,test}.txt                       official split, lines `<class_id>-<model_id>` (optional)
```
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from b23d.pipeline.dataset import Shape, dataset
from b23d.stages.datasets.annotations import MEND, AnnotationFile, readable, repeated
from b23d.stages.datasets.damage import WithDamage
from b23d.stages.datasets.external import Externals, WithExternals
from b23d.stages.datasets.files import uncollected
from b23d.stages.datasets.folder import NO_SHAPES
from b23d.stages.datasets.sources import source_leaf
from b23d.stages.datasets.walking import encodable, files_of

CLOUDS, MESHES = "pcds", "ShapeNetCore.v2.ply"


@dataset("keypointnet")
class KeypointNet(WithDamage, WithExternals):
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

        What cannot be read is a shape with an error: a class's annotation file, or one entry of it. Raises
        FileNotFoundError (no such root, class or annotations).
        """
        folder = self.root / "annotations"
        listing = files_of(folder, ".json")
        existing = {name[: -len(".json")]: Path(path) for path, name in listing.files.items()}
        if not existing:
            raise FileNotFoundError(
                f"keypointnet: expected annotations/<class>.json in {self.root}, got none; set dataset.root"
            )
        classes = sorted(existing) if self.classes is None else list(dict.fromkeys(self.classes))
        if unknown := [name for name in classes if name not in existing]:
            raise FileNotFoundError(
                f"keypointnet: expected classes among {', '.join(existing)} in {folder}, got {', '.join(unknown)}; "
                "set dataset.classes"
            )
        splits, externals = self._splits(), self.externals()
        shapes = [shape for name in classes for shape in self._class(name, existing[name], splits, externals)]
        if self.classes is None:
            shapes += [
                _aside(name[: -len(".json")], f"annotations/{name}: {why}") for name, why in listing.strange.items()
            ]
        return sorted(shapes, key=lambda shape: shape.name)

    def annotation_file(self, category: str) -> Path:
        return self.root / "annotations" / f"{category}.json"

    def unannotated(self) -> str:
        """As everywhere; "" where annotation files cannot be read, which is told of each."""
        files = [self.annotation_file(name) for name in self.classes or {shape.category for shape in self.shapes()}]
        return super().unannotated() if all(map(readable, files)) else ""

    def annotations_kept(self) -> str:
        return "its annotations are a published benchmark, and figures on changed ones cannot be compared"

    def class_ids(self, category: str) -> set[str]:
        """Entries name their class by a synset id."""
        entries = AnnotationFile.read(self.annotation_file(category)).entries
        return {category, *(entry["class_id"] for entry in entries if isinstance(entry.get("class_id"), str))}

    def _class(self, category: str, path: Path, splits: dict[str, str], externals: Externals) -> list[Shape]:
        """The class's shapes. An annotation file that cannot be read, or has no entry, is one shape with an error."""
        try:
            annotations = AnnotationFile.read(path)
        except (OSError, ValueError) as problem:
            return [_aside(category, str(problem))]
        if not annotations.entries and not annotations.malformed:
            return [_aside(category, f"{path}: expected entries of models, got an empty list; {MEND}")]
        listed: dict[str, dict[str, str]] = {}
        twice = repeated(f"{entry.get('class_id')}-{entry['model_id']}" for entry in annotations.entries)
        shapes = {f"entry {i}": Shape(f"entry {i}", category, {}, None, e) for i, e in annotations.malformed.items()}
        for entry in annotations.entries:
            class_id, model_id = entry.get("class_id"), entry["model_id"]
            name = f"{category}/{model_id}"
            leaves = {"keypoints": annotations.leaf(entry, name), **externals.leaves(category, model_id)}
            if not isinstance(class_id, str) or not encodable(class_id):
                wrong = f"{path}: expected a string `class_id` for model {model_id}, got {class_id!r}; {MEND}"
                shapes[model_id] = Shape(model_id, category, leaves, None, wrong)
                continue
            for part, suffix in ((CLOUDS, ".pcd"), (MESHES, ".ply")):
                if f"{part}/{class_id}" not in listed:
                    listed[f"{part}/{class_id}"] = _stems(self.root / part / class_id, suffix)
            cloud, mesh = listed[f"{CLOUDS}/{class_id}"].get(model_id), listed[f"{MESHES}/{class_id}"].get(model_id)
            error = self._missing(name, f"{class_id}/{model_id}", mesh, cloud)
            if f"{class_id}-{model_id}" in twice:
                error = f"{name}: expected one entry in {path}, got several; {MEND}"
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
        told = f"{name}: expected {expected} in {self.root}, got no such file"
        return f"{told}; add it, or leave the model out of the annotation file"

    def _splits(self) -> dict[str, str]:
        """`<class_id>-<model_id>` → train, val or test; empty where the data set has no splits folder."""
        splits: dict[str, str] = {}
        for split in ("train", "val", "test"):
            path = self.root / "splits" / f"{split}.txt"
            if path.is_file():
                splits.update(dict.fromkeys(path.read_text(errors="replace").split(), split))
        return splits


def _aside(category: str, error: str) -> Shape:
    """Stands for all shapes of a class that has none we can list."""
    return Shape(NO_SHAPES, category, {}, None, error)


def _stems(folder: Path, suffix: str) -> dict[str, str]:
    """The paths of the folder's regular files with this suffix, by stem; none where there is no such folder."""
    return {name[: -len(suffix)]: path for path, name in files_of(folder, suffix).files.items()}
