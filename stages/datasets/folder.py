"""A folder of meshes and clouds, with or without keypoints.

```
<root>/<category>/**/<id>.<ply|obj|off|stl|glb|gltf>     meshes
<root>/<category>/**/<id>.<pcd|xyz|npz>                  clouds; beside a mesh of the same id, they give its candidates
<root>/keypoints.json                                    keypoints in KeypointNet's form (optional)
```
Where all files lie in `<root>` itself, the category is its name.
"""

from __future__ import annotations

from fnmatch import fnmatch
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from b23d.pipeline.dataset import Leaf, Shape, dataset
from b23d.stages.datasets.annotations import AnnotationFile
from b23d.stages.datasets.external import WithExternals
from b23d.stages.datasets.files import Companions, has_faces, uncollected, walk
from b23d.stages.datasets.sources import source_leaf
from b23d.stages.geometry.loading import CLOUD_SUFFIXES, MESH_SUFFIXES

Key = tuple[str, str]
"""Category and id."""


@dataset("folder")
class Folder(WithExternals):
    """Any folder of shapes."""

    kind: Literal["folder"] = "folder"
    root: Path
    """Where the shapes are. Hidden files and folders are passed over; symbolic links are followed."""
    keypoints: Path | None = None
    """Annotation file in KeypointNet's form; its `model_id` is a shape's id, its `class_id` (optional) the category.
    None: `<root>/keypoints.json` if it exists. Shapes without an entry are unannotated: they get features and
    predictions."""
    pattern: str = "*"
    """Only files whose path below the root matches; `*` also matches `/`: `"*/models/*.obj"`."""
    id: Literal["stem", "folder"] = "stem"
    """A shape's id: its file's stem, or the folder below the category (ShapeNet's
    `<class>/<id>/models/model_normalized.obj`)."""
    category: str | None = Field(None, min_length=1)
    """One category for all shapes, wherever below the root they lie; None: the first folder's name."""

    @uncollected()
    def shapes(self) -> list[Shape]:
        """All shapes, sorted by name; entries of the annotation file without a file are shapes with an error.

        Raises FileNotFoundError (no such root, no geometry below it, no such annotation file) and ValueError (two files
        for one shape, unreadable annotations).
        """
        if not self.root.is_dir():
            raise FileNotFoundError(f"folder: expected a folder {self.root}, got none; set dataset.root")
        files = walk(self.root)
        found = self._found({path: place for path, place in files.items() if fnmatch(place, self.pattern)})
        if not found:
            formats = " ".join((*MESH_SUFFIXES, *CLOUD_SUFFIXES))
            raise FileNotFoundError(
                f"folder: expected files like {self.pattern} of {formats} below {self.root}, got none; "
                "set dataset.root or dataset.pattern"
            )
        keypoints, errors = self._annotations(found)
        companions, externals = Companions(files), self.externals()
        shapes = [Shape(key[1], key[0], {}, None, error) for key, error in errors.items() if key not in found]
        for key, roles in found.items():
            name = "/".join(key)
            mesh = roles.get("mesh")
            leaves = {"source": source_leaf(name, mesh, roles.get("cloud"), companions.of(mesh) if mesh else None)}
            if key in keypoints:
                leaves["keypoints"] = keypoints[key]
            leaves |= externals.leaves(*key)
            shapes.append(Shape(key[1], key[0], leaves, None, errors.get(key)))
        return sorted(shapes, key=lambda shape: shape.name)

    def _found(self, files: dict[str, str]) -> dict[Key, dict[str, str]]:
        """The mesh and the cloud of each shape, from all files (path → place below the root)."""
        flat = self.root.resolve().name or "shapes"
        by_shape: dict[Key, list[str]] = {}
        for path, place in files.items():
            stem, dot, suffix = place.rpartition("/")[2].rpartition(".")
            if dot and f".{suffix.lower()}" in MESH_SUFFIXES + CLOUD_SUFFIXES:
                folders = place.split("/")[:-1]
                category = self.category or (folders[0] if folders else flat)
                below = folders if self.category else folders[1:]
                by_shape.setdefault((category, below[0] if self.id == "folder" and below else stem), []).append(path)
        return {key: self._roles("/".join(key), sorted(paths)) for key, paths in by_shape.items()}

    def _roles(self, name: str, paths: list[str]) -> dict[str, str]:
        clouds = [path for path in paths if path.lower().endswith(CLOUD_SUFFIXES)]
        meshes = [path for path in paths if path not in clouds]
        if len(meshes) > 1 or (meshes and not clouds and len(paths) > 1):
            pointed = [path for path in meshes if path.lower().endswith(".ply") and not has_faces(path)]
            clouds, meshes = clouds + pointed, [path for path in meshes if path not in pointed]
        for what, same in (("mesh", meshes), ("cloud", clouds)):
            if len(same) > 1:
                raise ValueError(
                    f"{name}: expected one {what}, got {' and '.join(same)}; "
                    "rename one, choose files with dataset.pattern, "
                    'or set dataset.id = "folder"'
                )
        return {what: same[0] for what, same in (("mesh", meshes), ("cloud", clouds)) if same}

    def _annotations(self, found: dict[Key, dict[str, str]]) -> tuple[dict[Key, Leaf], dict[Key, str]]:
        """The keypoints leaf of every annotated shape, and what is wrong with entries, by shape."""
        path = self.keypoints if self.keypoints is not None else self.root / "keypoints.json"
        if self.keypoints is None and not path.is_file():
            return {}, {}
        file = AnnotationFile.read(path)
        categories: dict[str, list[str]] = {}
        for category, name in found:
            categories.setdefault(name, []).append(category)
        leaves: dict[Key, Leaf] = {}
        errors: dict[Key, str] = {}
        for entry in file.entries:
            key, error = self._owner(entry, categories, path)
            if key in leaves:
                error = f"{'/'.join(key)}: expected one entry in {path}, got several; mend the annotation file"
            if error is not None:
                errors[key] = error
            leaves[key] = file.leaf(entry, "/".join(key))
        return leaves, errors

    def _owner(self, entry: dict[str, Any], categories: dict[str, list[str]], path: Path) -> tuple[Key, str | None]:
        """The shape an entry is about, and an error where there is no such shape."""
        model, category = entry["model_id"], entry.get("class_id")
        having = categories.get(model, [])
        if category in having:
            return (category, model), None
        if len(having) == 1:
            return (having[0], model), None
        key = (category if isinstance(category, str) and category else self.root.resolve().name or "shapes", model)
        if having:
            return (
                key,
                f"{model}: expected class_id among {', '.join(having)} in {path}, got {category!r}; "
                "mend the annotation file",
            )
        name = "/".join(key)
        return (
            key,
            f"{name}: expected a mesh or cloud {model}.* below {self.root}, got none; "
            f"add it, or drop its entry from {path}",
        )
