"""A folder of meshes and clouds, with or without keypoints.

```
<root>/<category>/**/<id>.<ply|obj|off|stl|glb|gltf>     meshes
<root>/<category>/**/<id>.<pcd|xyz|npz>                  clouds; beside a mesh of the same id, they give its candidates
<root>/keypoints.json                                    keypoints in KeypointNet's form (optional)
```
Files called `<name>.b23d.<suffix>` are this program's own exports, and passed over.
Where all files lie in `<root>` itself, the category is its name.
"""

from __future__ import annotations

import os
from collections.abc import Collection
from fnmatch import fnmatch
from pathlib import Path, PureWindowsPath
from typing import Any, Literal

from pydantic import Field

from b23d.pipeline.dataset import Leaf, Shape, dataset, is_export
from b23d.pipeline.errors import reason
from b23d.stages.datasets.annotations import AnnotationFile, looks_annotated, readable
from b23d.stages.datasets.damage import WithDamage
from b23d.stages.datasets.external import WithExternals
from b23d.stages.datasets.files import IMAGES, Companions, has_faces, uncollected
from b23d.stages.datasets.sources import source_leaf
from b23d.stages.datasets.walking import Listing, encodable, hidden, printable, walk
from b23d.stages.geometry.loading import CLOUD_SUFFIXES, MESH_SUFFIXES

ShapeKey = tuple[str, str]
"""Category and id."""
NO_SHAPES = "(no shapes)"
"""Stands for the shapes of a class that has none."""
BESIDE = (*IMAGES, ".mtl", ".bin")
"""What a folder without shapes may hold for the shapes elsewhere."""


@dataset("folder")
class Folder(WithDamage, WithExternals):
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
        """All shapes, sorted by name. What cannot be used is a shape with an error: entries of the annotation file
        without a file, two files for one shape, pipes, links to nothing, folders that cannot be read, classes without
        shapes.

        Raises FileNotFoundError (no such root, no geometry below it, no such annotation file), PermissionError (the
        root must not be entered).
        """
        if not self.root.is_dir():
            raise FileNotFoundError(f"folder: expected a folder {self.root}, got none; set dataset.root")
        listing = walk(self.root)
        found, errors = self._found(listing.files)
        if closed := listing.closed.get(printable(str(self.root))):
            raise PermissionError(f"folder {self.root}: {closed}")
        if not found and not errors and not any(map(self._key, listing.strange)):
            formats = " ".join((*MESH_SUFFIXES, *CLOUD_SUFFIXES))
            raise FileNotFoundError(
                f"folder: expected files like {self.pattern} of {formats} below {self.root}, got none; "
                "set dataset.root or dataset.pattern"
            )
        keypoints, wrong = self._annotations(found)
        errors |= wrong
        companions, externals = Companions(listing.files), self.externals()
        shapes = [
            Shape(key[1], key[0], {}, None, error, "keypoints" if key in wrong else "")
            for key, error in errors.items()
            if key not in found
        ]
        for key, roles in found.items():
            leaves: dict[str, Leaf] = {}
            error = errors.get(key)
            try:
                mesh = roles.get("mesh")
                beside = companions.of(mesh) if mesh else None
                leaves["source"] = source_leaf("/".join(key), mesh, roles.get("cloud"), beside)
            except (OSError, ValueError, RecursionError) as problem:
                error = (
                    error or f"{'/'.join(key)}: {type(problem).__name__}: {reason(problem)}; mend or remove its file"
                )
            if key in keypoints:
                leaves["keypoints"] = keypoints[key]
            leaves |= externals.leaves(*key)
            shapes.append(Shape(key[1], key[0], leaves, None, error))
        return sorted([*shapes, *self._set_aside(listing, found, errors)], key=lambda shape: shape.name)

    def annotation_file(self, category: str = "") -> Path:
        return self.keypoints if self.keypoints is not None else self.root / "keypoints.json"

    def annotations_kept(self) -> str:
        return ""

    def unannotated(self) -> str:
        if os.path.lexists(self.annotation_file()) and not readable(self.annotation_file()):
            return ""  # what is wrong with it is told already
        looked = f"annotations: expected keypoints in {self.annotation_file()}, got "
        if not self.annotation_file().is_file():
            near = [str(self.root.parent / "keypoints.json"), *walk(self.root).files]
            elsewhere = [path for path in near if path.lower().endswith(".json") and looks_annotated(path)][:3]
            if elsewhere:
                return f"{looked}no such file, but {' and '.join(elsewhere)}; move it there, or set dataset.keypoints"
            return f"{looked}no such file; annotate shapes with `b23d annotate`, or set dataset.keypoints"
        return f"{looked}none of a shape that is here; annotate shapes with `b23d annotate`"

    def _found(self, files: dict[str, str]) -> tuple[dict[ShapeKey, dict[str, str]], dict[ShapeKey, str]]:
        """The mesh and the cloud of each shape, from all files (path → place below the root), and what is wrong."""
        by_shape: dict[ShapeKey, list[str]] = {}
        for path, place in files.items():
            if (key := self._key(place)) is not None:
                by_shape.setdefault(key, []).append(path)
        found: dict[ShapeKey, dict[str, str]] = {}
        errors: dict[ShapeKey, str] = {}
        for key, paths in by_shape.items():
            try:
                found[key] = self._roles("/".join(key), sorted(paths))
            except (OSError, ValueError) as error:
                errors[key] = reason(error)
        return found, errors

    def _key(self, place: str) -> ShapeKey | None:
        """The shape that a file (by its place below the root) is of; None where it is no geometry of ours."""
        *folders, file = place.split("/")
        stem, dot, suffix = file.rpartition(".")
        if not dot or f".{suffix.lower()}" not in MESH_SUFFIXES + CLOUD_SUFFIXES or is_export(file):
            return None
        if not fnmatch(place, self.pattern):
            return None
        category = self.category or (folders[0] if folders else self._flat())
        below = folders if self.category else folders[1:]
        return category, below[0] if self.id == "folder" and below else stem

    def _flat(self) -> str:
        """The class of what lies right in the root."""
        return self.root.resolve().name or "shapes"

    def _set_aside(self, listing: Listing, found: Collection[ShapeKey], errors: Collection[ShapeKey]) -> list[Shape]:
        """What cannot be used, each by its name: strange files that would be shapes, closed folders, empty classes."""
        shapes = []
        known = {*found, *errors}
        for place, why in listing.strange.items():
            key = self._key(place)
            if key is not None and key not in known:
                shapes.append(Shape(key[1], key[0], {}, None, f"{place}: {why}"))
                known.add(key)
        for place, why in listing.closed.items():
            category, _, name = place.partition("/") if "/" in place else (self._flat(), "", place)
            shapes.append(Shape(name, category, {}, None, f"{place}: {why}"))
        for category in self._empty(listing, {category for category, _ in known}):
            error = f"{category}: expected a class with meshes or clouds in {self.root}, got a folder without any"
            shapes.append(Shape(NO_SHAPES, category, {}, None, f"{error}; add shapes, or remove the folder"))
        return shapes

    def _empty(self, listing: Listing, categories: Collection[str]) -> list[str]:
        """Folders that look like classes of this layout and have no shape, nor what shapes need."""
        holding = {place.split("/")[0]: place for place in listing.files.values() if "/" in place}
        if self.category or self.pattern != "*" or not categories & holding.keys():
            return []
        needed = {place.split("/")[0] for place in listing.files.values() if place.lower().endswith(BESIDE)}
        with os.scandir(self.root) as entries:
            folders = [e.name for e in entries if not hidden(e.name) and e.is_dir() and encodable(e.name)]
        return sorted({*folders} - {*categories} - needed - {*listing.closed, self.annotation_file().name})

    def _roles(self, name: str, paths: list[str]) -> dict[str, str]:
        clouds = [path for path in paths if path.lower().endswith(CLOUD_SUFFIXES)]
        meshes = [path for path in paths if path not in clouds]
        if len(meshes) > 1 or (meshes and not clouds and len(paths) > 1):
            pointed = [path for path in meshes if path.lower().endswith(".ply") and not has_faces(path)]
            clouds, meshes = clouds + pointed, [path for path in meshes if path not in pointed]
        for what, same in (("mesh", meshes), ("cloud", clouds)):
            if len(same) > 1:
                raise ValueError(
                    f"{name}: expected one {what}, got {' and '.join(same)}; rename one, choose files with "
                    'dataset.pattern, or set dataset.id = "folder"'
                )
        return {what: same[0] for what, same in (("mesh", meshes), ("cloud", clouds)) if same}

    def _annotations(self, found: Collection[ShapeKey]) -> tuple[dict[ShapeKey, Leaf], dict[ShapeKey, str]]:
        """The keypoints leaf of every annotated shape, and what is wrong with entries, by shape."""
        path = self.annotation_file()
        if self.keypoints is None and not os.path.lexists(path):
            return {}, {}
        try:
            file = AnnotationFile.read(path)
        except FileNotFoundError:
            if self.keypoints is not None:
                raise
            return {}, {(self._flat(), path.name): f"{path}: expected a file, got something else; remove it"}
        except (OSError, ValueError) as problem:
            return {}, {(self._flat(), path.name): str(problem)}
        categories: dict[str, list[str]] = {}
        for category, name in found:
            categories.setdefault(name, []).append(category)
        leaves: dict[ShapeKey, Leaf] = {}
        errors = {(self._flat(), f"{path.name} entry {i}"): error for i, error in file.malformed.items()}
        for entry in file.entries:
            key, error = self._owner(entry, categories, path)
            if key in leaves:
                error = f"{'/'.join(key)}: expected one entry in {path}, got several; mend the annotation file"
            if error is not None:
                errors[key] = error
            leaves[key] = file.leaf(entry, "/".join(key))
        return leaves, errors

    def _owner(
        self, entry: dict[str, Any], categories: dict[str, list[str]], path: Path
    ) -> tuple[ShapeKey, str | None]:
        """The shape an entry is about, and an error where there is no such shape."""
        model, category = entry["model_id"], entry.get("class_id")
        having = categories.get(model, [])
        if category in having:
            return (category, model), None
        if len(having) == 1:
            return (having[0], model), None
        key = (category if isinstance(category, str) and category and encodable(category) else self._flat(), model)
        if having:
            got = "none" if category is None else repr(category)
            expected = f"{model}: expected class_id among {', '.join(having)}, which all have such a shape, got {got}"
            return key, f"{expected}; say it in {path}"
        expected = f"{'/'.join(key)}: expected a mesh or cloud {model}.* below {self.root}, got none"
        said = PureWindowsPath(model)  # which knows both slashes
        if meant := next((name for name in (said.name, said.stem) if name in categories), None):
            return key, f'{expected}; model_id "{meant}" in {path} names it by its file, without folder and suffix'
        return key, f"{expected}; add it, or drop its entry from {path}"
