"""What a folder of shapes holds, before anybody has written a run file for it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from b23d.pipeline.dataset import Dataset, Shape
from b23d.pipeline.errors import naming
from b23d.schemas.shape import Source
from b23d.stages.datasets.folder import Folder
from b23d.stages.datasets.keypointnet import KeypointNet
from b23d.stages.datasets.shapenetpart import ShapeNetPart
from b23d.stages.datasets.walking import walk
from b23d.stages.geometry.loading import CLOUD_SUFFIXES, MESH_SUFFIXES, load
from b23d.stages.geometry.surface import Surface
from b23d.stages.geometry.upright import Stance, Upright, guess, stance

MEASURED = 6
"""Shapes of each class that are opened."""


@dataclass
class ClassSurvey:
    """One class."""

    name: str
    shapes: int = 0
    formats: Counter[str] = field(default_factory=Counter)
    annotated: list[str] = field(default_factory=list)
    """Ids of the shapes that have keypoints."""
    sizes: tuple[float, float] | None = None
    """Least and greatest longest side of those measured, in the files' units."""
    box: tuple[float, float, float] | None = None
    """Median x, y and z extent of those measured."""
    up: Upright | None = None


@dataclass(frozen=True)
class Measured:
    """A shape that was opened."""

    extent: np.ndarray
    """(3,), in the file's units."""
    mesh: bool
    stance: Stance | None
    """None where it does not tell, as no cloud does."""


@dataclass
class Survey:
    """A folder as it was understood."""

    dataset: Dataset
    settings: dict[str, Any]
    """Fields of `[dataset]` that this folder needs, besides `kind` and `root`."""
    classes: list[ClassSurvey]
    problems: list[str]
    """What is wrong with single shapes or entries."""

    @property
    def shapes(self) -> int:
        return sum(each.shapes for each in self.classes)

    @property
    def annotated(self) -> int:
        return sum(len(each.annotated) for each in self.classes)


def survey(root: Path, watch: Callable[[int, int], None] = lambda done, total: None) -> Survey:
    """Look at a folder: its layout, classes, formats, annotations, and the extents and up axis of some of its shapes.

    Raises FileNotFoundError where there is no such folder or nothing in it that can be read, ValueError where no layout
    fits.
    """
    if not root.is_dir():
        raise FileNotFoundError(
            f"init: expected a folder, got none at {root}; give the folder of your meshes or clouds"
        )
    dataset, settings = _layout(root.resolve())
    shapes = dataset.shapes()
    classes: dict[str, ClassSurvey] = {}
    for shape in shapes:
        each = classes.setdefault(shape.category, ClassSurvey(shape.category))
        if shape.error is None:
            each.shapes += 1
            each.formats.update({path.suffix.lower() for path in _geometry(shape)})
            if "keypoints" in shape.leaves:
                each.annotated.append(shape.id)
    problems = [shape.error for shape in shapes if shape.error is not None]
    chosen = [shape for name in classes for shape in _spread([s for s in shapes if s.category == name and not s.error])]
    measured: dict[str, list[Measured]] = {}
    for done, shape in enumerate(chosen, 1):
        try:
            measured.setdefault(shape.category, []).append(_measure(shape))
        except (OSError, ValueError) as error:
            problems.append(naming(shape.name, str(error)))
        watch(done, len(chosen))
    for name, each in classes.items():
        _summarise(each, measured.get(name, []))
    return Survey(dataset, settings, [each for each in classes.values() if each.shapes], problems)


def _layout(root: Path) -> tuple[Dataset, dict[str, Any]]:
    """The data set that reads this folder. Raises FileNotFoundError or ValueError, the folder data set's own."""
    if any((root / "annotations").glob("*.json")) and any(
        (root / name).is_dir() for name in ("pcds", "ShapeNetCore.v2.ply")
    ):
        return KeypointNet(root=root), {}
    if (root / "synsetoffset2category.txt").is_file():
        return ShapeNetPart(root=root), {}
    best: tuple[int, Dataset, dict[str, Any]] | None = None
    failure: Exception | None = None
    # as it lies; ShapeNet's <class>/<id>/models/model_normalized.obj; one format of several
    for settings in ({}, {"id": "folder"}, {"pattern": _pattern(root)}):
        dataset = Folder.model_validate({"root": root, **settings})
        try:
            wrong = sum(shape.error is not None for shape in dataset.shapes())
        except (OSError, ValueError) as error:
            failure = failure or error
            continue
        if best is None or wrong < best[0]:
            best = wrong, dataset, settings
        if wrong == 0:
            break
    if best is None:
        assert failure is not None
        raise failure
    return best[1], best[2]


def _pattern(root: Path) -> str:
    suffixes = Counter(Path(path).suffix for path in walk(root).files)
    known = {s: n for s, n in suffixes.items() if s.lower() in MESH_SUFFIXES + CLOUD_SUFFIXES}
    return f"*{max(known, key=lambda suffix: known[suffix])}" if known else "*"


def _geometry(shape: Shape) -> list[Path]:
    leaf = shape.leaves.get("source")
    if leaf is None:
        return []
    names = [leaf.values.get("mesh"), leaf.values.get("cloud")]
    return [leaf.files[name] for name in names if name in leaf.files]


def _spread(shapes: list[Shape]) -> Iterable[Shape]:
    """Some of the shapes, evenly over the list."""
    places = np.unique(np.linspace(0, len(shapes) - 1, min(MEASURED, len(shapes))).astype(int))
    return [shapes[place] for place in places]


def _measure(shape: Shape) -> Measured:
    """Raises OSError or ValueError."""
    source = shape.leaves["source"].read()
    assert isinstance(source, Source)
    name = source.mesh if source.mesh is not None else source.cloud
    assert name is not None
    loaded = load(shape.name, source.files, name, False, source.own_names)
    if isinstance(loaded, Surface):
        used = loaded.vertices[np.unique(loaded.faces)]
        return Measured(_extent(used), True, stance(loaded.vertices, loaded.faces))
    return Measured(_extent(loaded.points), False, None)


def _extent(points: np.ndarray) -> np.ndarray:
    finite = points[np.isfinite(points).all(axis=1)]
    return np.ptp(finite, axis=0) if len(finite) else np.zeros(3)


def _summarise(each: ClassSurvey, measured: list[Measured]) -> None:
    if measured:
        extents = np.stack([one.extent for one in measured])
        longest = extents.max(axis=1)
        each.sizes = float(longest.min()), float(longest.max())
        x, y, z = (float(value) for value in np.median(extents, axis=0))
        each.box = x, y, z
        stances = [one.stance for one in measured if one.mesh]
        each.up = guess(stances) if stances else None
