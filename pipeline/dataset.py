"""Data sets as declared tables of a run file: a data set lists shapes, and gives each shape its leaves.

A leaf is what a stage may ask for that no stage makes: `source`, `keypoints`, `parts`. Its digest (of bytes and values,
never of paths) is where every address begins.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from b23d.pipeline.errors import unreadable
from b23d.schemas.artifact import Artifact
from b23d.schemas.params import Params
from b23d.schemas.up_axis import Up, axes_of


@dataclass(frozen=True)
class Leaf:
    """How to get one leaf. Small and picklable: it travels to workers; the bytes do not.

    `load(files, values)` is a module-level function; `files` are read by the engine (name → bytes) on the worker.
    The digest is the sha256 of `values` and of the files' names and bytes; paths, and `context`, never enter it.
    """

    load: Callable[[dict[str, bytes], dict[str, Any]], Artifact]
    values: dict[str, Any] = field(default_factory=dict)
    """JSON values."""
    files: dict[str, Path] = field(default_factory=dict)
    """Name under which `load` and the digest know the file → where it is."""
    context: dict[str, Any] = field(default_factory=dict)
    """Merged into `values` for `load` only: what should be recorded but must not change an address (a file's hash, a
    name)."""

    def read(self) -> Artifact:
        """What the leaf holds. Raises OSError where a file cannot be read, ValueError where `load` refuses it."""
        files = {name: _bytes(path) for name, path in self.files.items()}
        return self.load(files, {**self.values, **self.context})


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise unreadable(path, error) from error


UNORIENTED = "unoriented"
"""The leaf that shapes have beside `source`, and the same, where it is to be found which axis points up."""


@dataclass(frozen=True)
class Shape:
    """One shape of a data set. `name` is `<category>/<id>`, unique in the data set."""

    id: str
    category: str
    leaves: dict[str, Leaf]
    official: str | None = None
    """The data set's own split this shape is in (train, val, test), if it has splits."""
    error: str | None = None
    """Why this shape cannot be used, if listing the data set already tells; it is quarantined under its name."""
    about: str = ""
    """The leaf that the error is about, where the shape stands for no geometry but for a part of what holds that leaf,
    such as an entry of an annotation file: stages that take no such leaf do without it. "": for all of them."""

    name: str = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", f"{self.category}/{self.id}")


class Dataset(Params):
    """Base of every `[dataset]` table. Path fields are made absolute by the run file's loader before validation."""

    handed_over: ClassVar[bool] = False
    """Whether its shapes are handed over in Python, so that a run file by itself has none."""

    kind: str
    up: Up = "y"
    """Which axis of the files points up: `y`, `z`, `x`, `-x`, `-y` or `-z`; `auto`: found for each shape by its
    likeness to the shots; or a table where they differ: class, shape (`<class>/<id>`) or pattern (`chair/old-*`) → one
    of these, of which the most specific counts. Shapes are brought to +y up for everything that is made of them;
    annotations and results are in the files' own coordinates."""

    def listed(self) -> list[Shape]:
        """As `shapes`, each with the up axis that `up` says. Raises as `shapes`, and ValueError where `up` names what
        is not there."""
        shapes = self.shapes()
        if self.up == "y":
            return shapes
        axes = axes_of(self.up, [(shape.category, shape.id) for shape in shapes])
        return [_standing(shape, axes[shape.category, shape.id]) for shape in shapes]

    def lacks(self) -> set[str]:
        """Leaves that some data sets have, and no shape of this one: stages that are only for these are not planned."""
        choices = self.up.values() if isinstance(self.up, dict) else [self.up]
        return set() if "auto" in choices else {UNORIENTED}

    @abstractmethod
    def shapes(self) -> list[Shape]:
        """All shapes, sorted by name; cheap: no geometry is read.

        Raises FileNotFoundError or ValueError where the data set as a whole cannot be used.
        """
        raise NotImplementedError

    def annotation_file(self, category: str) -> Path | None:
        """The JSON file that the keypoints of a class are read from, whether it is there yet or not; None: no such
        file."""
        return None

    def annotations_kept(self) -> str:
        """Why `annotation_file` must not be written by hand; "" where it may."""
        return "its annotations are not a file of ours"

    def class_ids(self, category: str) -> set[str]:
        """What entries of an annotation file may call the class."""
        return {category}

    def unannotated(self) -> str:
        """What to tell where no shape is annotated: where annotations are looked for, and what lies elsewhere; "" where
        shapes' errors tell it already."""
        return "annotations: expected some, got none; annotate shapes, or ask for stages that need none in `outputs`"

    def covers(self, path: Path) -> bool:
        """Whether a new file at `path` would lie where this data set looks for its own."""
        fields = (getattr(self, name) for name in type(self).model_fields)
        return any(isinstance(value, Path) and path.resolve().is_relative_to(value.resolve()) for value in fields)


@dataclass(frozen=True)
class _Upright:
    """Loads a source, and says which axis of it points up: loaders themselves need not know."""

    load: Callable[[dict[str, bytes], dict[str, Any]], Artifact]

    def __call__(self, files: dict[str, bytes], values: dict[str, Any]) -> Artifact:
        up = None if values["up"] == "auto" else values["up"]
        source = self.load(files, {key: value for key, value in values.items() if key != "up"})
        return source.model_copy(update={"up": up})


def _standing(shape: Shape, up: str) -> Shape:
    """The shape whose file has `up` for its up axis, or `auto`; that enters the address unless it is +y."""
    leaf = shape.leaves.get("source")
    if up == "y" or leaf is None:
        return shape
    told = replace(leaf, load=_Upright(leaf.load), values={**leaf.values, "up": up})
    found = {UNORIENTED: told} if up == "auto" else {}
    return replace(shape, leaves={**shape.leaves, "source": told, **found})


def is_export(name: str) -> bool:
    """Whether a file of this name was exported by this program, as `<stem>.b23d.<suffix>`: never a shape."""
    return ".b23d." in name


DATASETS: dict[str, type[Dataset]] = {}
Kind = TypeVar("Kind", bound=type[Dataset])


def dataset(kind: str) -> Callable[[Kind], Kind]:
    """Declare a Dataset class as `[dataset] kind = "<kind>"`."""

    def declare(cls: Kind) -> Kind:
        DATASETS[kind] = cls
        return cls

    return declare
