"""ShapeNetPart (Yi et al., SIGGRAPH Asia 2016), in the layout that carries normals.

```
<root>/synsetoffset2category.txt                     lines `Airplane<tab>02691156`
<root>/<synset>/<id>.txt                             rows `x y z nx ny nz label`
<root>/train_test_split/shuffled_train_file_list.json  (val, test)  ["shape_data/02691156/1021a0…", …] (optional)
```
The archive's name is `shapenetcore_partanno_segmentation_benchmark_v0_normal`. Labels run through all classes
(airplanes have 0 … 3, bags 4 and 5 …); here each class counts its own from 0, and a part's name is the data set's own
label, as text.
"""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any, Literal

import numpy as np

from b23d.pipeline.dataset import Dataset, Leaf, Shape, dataset
from b23d.pipeline.errors import reason
from b23d.schemas.parts import Parts
from b23d.schemas.shape import Source
from b23d.stages.datasets.folder import NO_SHAPES
from b23d.stages.datasets.walking import files_of

LABELS = {
    "Airplane": range(0, 4), "Bag": range(4, 6), "Cap": range(6, 8), "Car": range(8, 12), "Chair": range(12, 16),
    "Earphone": range(16, 19), "Guitar": range(19, 22), "Knife": range(22, 24), "Lamp": range(24, 28),
    "Laptop": range(28, 30),
    "Motorbike": range(30, 36), "Mug": range(36, 38), "Pistol": range(38, 41), "Rocket": range(41, 44),
    "Skateboard": range(44, 47), "Table": range(47, 50),
}  # fmt: skip
COLUMNS = 7
FILE = "points.txt"
SUFFIX = ".txt"


@dataset("shapenetpart")
class ShapeNetPart(Dataset):
    """ShapeNetPart's clouds with their human part labels. Clouds have no mesh: the renderer draws them as discs."""

    kind: Literal["shapenetpart"] = "shapenetpart"
    root: Path
    """Folder with `synsetoffset2category.txt`."""
    classes: list[str] | None = None
    """Which classes, by the names in `synsetoffset2category.txt`. None: all that have a folder."""

    def shapes(self) -> list[Shape]:
        """All shapes of the classes, sorted by name; those that a split lists without a file carry an error.

        Raises FileNotFoundError (no such root or class) and ValueError (unreadable lists, a class whose labels are not
        known).
        """
        synsets = self._synsets()
        existing = [name for name, synset in synsets.items() if (self.root / synset).is_dir()]
        wanted = existing if self.classes is None else list(dict.fromkeys(self.classes))
        if absent := [name for name in wanted if name not in existing]:
            known = f"{', '.join(existing) or 'none'} in {self.root}"
            raise FileNotFoundError(
                f"shapenetpart: expected classes among {known}, got {', '.join(absent)}; set dataset.classes"
            )
        expected = f"shapenetpart: expected classes among {', '.join(LABELS)}, got"
        strange = [name for name in wanted if name not in LABELS]
        if strange and self.classes is not None:
            raise ValueError(f"{expected} {', '.join(strange)}; set dataset.classes")
        splits = self._splits()
        shapes = [Shape(NO_SHAPES, name, {}, None, f"{expected} {name}; set dataset.classes") for name in strange]
        for category in wanted:
            if category in LABELS:
                shapes += self._class(category, synsets[category], splits)
        return sorted(shapes, key=lambda shape: shape.name)

    def _class(self, category: str, synset: str, splits: dict[str, str]) -> list[Shape]:
        listing = files_of(self.root / synset, SUFFIX)
        files = {name[: -len(SUFFIX)]: Path(path) for path, name in listing.files.items()}
        wrong = {name[: -len(SUFFIX)]: f"{synset}/{name}: {why}" for name, why in listing.strange.items()}
        listed = {key.partition("/")[2]: split for key, split in splits.items() if key.partition("/")[0] == synset}
        if not files and not wrong and not listed:
            got = "; ".join(listing.closed.values()) or f"expected clouds {synset}/<id>.txt in {self.root}, got none"
            wrong[NO_SHAPES] = f"{category}: {got}; add them, or leave the class out of dataset.classes"
        shapes = [Shape(name, category, {}, listed.get(name), error) for name, error in wrong.items()]
        for name in files.keys() | listed.keys() - wrong.keys():
            if name in files:
                shapes.append(Shape(name, category, _leaves(files[name], category, name), listed.get(name)))
            else:
                error = f"{category}/{name}: expected {synset}/{name}.txt in {self.root}, got no such file"
                shapes.append(
                    Shape(name, category, {}, listed[name], f"{error}; add it, or take it off the split's list")
                )
        return shapes

    def _synsets(self) -> dict[str, str]:
        path = self.root / "synsetoffset2category.txt"
        if not path.is_file():
            raise FileNotFoundError(
                f"shapenetpart: expected {path}, got none; set dataset.root to the folder that holds it"
            )
        lines = [line.split() for line in path.read_text().splitlines() if line.strip()]
        if any(len(line) != 2 for line in lines):
            raise ValueError(f"{path}: expected lines of a class and its synset, got others; restore the file")
        return {line[0]: line[1] for line in lines}

    def _splits(self) -> dict[str, str]:
        """`<synset>/<id>` → train, val or test; empty where there are no lists."""
        splits: dict[str, str] = {}
        for split in ("train", "val", "test"):
            path = self.root / "train_test_split" / f"shuffled_{split}_file_list.json"
            if not path.is_file():
                continue
            try:
                splits.update({"/".join(entry.split("/")[-2:]): split for entry in json.loads(path.read_text())})
            except (OSError, ValueError, AttributeError, TypeError, RecursionError) as error:
                raise ValueError(
                    f"{path}: expected a list of `shape_data/<synset>/<id>`, got {reason(error)}; restore the file"
                ) from error
        return splits


def load_source(files: dict[str, bytes], values: dict[str, Any]) -> Source:
    """The cloud alone. Raises ValueError, naming the shape, as `load_parts`."""
    buffer = io.BytesIO()
    np.savez(buffer, points=_rows(files, values)[:, :3])
    return Source(shape=values["shape"], files={"cloud.npz": buffer.getvalue()}, cloud="cloud.npz")


def load_parts(files: dict[str, bytes], values: dict[str, Any]) -> Parts:
    """The labels at every point of the cloud, counted from 0 in each class.

    Raises ValueError, naming the shape: rows that are not seven numbers, none at all, labels of another class.
    """
    rows = _rows(files, values)
    first, count = values["first"], values["count"]
    labels = rows[:, -1] - first
    if wrong := sorted({float(label) for label in rows[~np.isin(labels, np.arange(count)), -1]}):
        raise ValueError(
            f"{values['shape']}: expected labels {first} … {first + count - 1}, got {wrong[0]:g}; restore the file"
        )
    return Parts(points=rows[:, :3], labels=labels.astype(np.int32), names=[str(first + i) for i in range(count)])


def _leaves(path: Path, category: str, name: str) -> dict[str, Leaf]:
    labels = {"first": LABELS[category].start, "count": len(LABELS[category])}
    context = {"shape": f"{category}/{name}"}
    return {
        "source": Leaf(load_source, {"leaf": "source"}, {FILE: path}, context),
        "parts": Leaf(load_parts, {"leaf": "parts", **labels}, {FILE: path}, context),
    }


def _rows(files: dict[str, bytes], values: dict[str, Any]) -> np.ndarray:
    from b23d.stages.geometry.surface import MalformedError
    from b23d.stages.geometry.text import numbers, plain, tokens_per_line

    text = plain(files[FILE])
    try:
        found, widths = numbers(text, "points"), tokens_per_line(text)
    except MalformedError as error:
        raise ValueError(f"{values['shape']}: {error}") from error
    if not len(found) or (widths[widths > 0] != COLUMNS).any() or len(found) % COLUMNS:
        got = sorted(set(widths[widths > 0].tolist()))
        expected = f"{values['shape']}: expected rows `x y z nx ny nz label`"
        raise ValueError(f"{expected}, got rows of {got or 'no'} numbers; restore the file")
    return found.reshape(-1, COLUMNS)
