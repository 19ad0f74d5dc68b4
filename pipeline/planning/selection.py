"""Which of a run's shapes and stages a command is about: it narrows targets, and never changes addresses or draws."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from b23d.pipeline.dataset import Shape
from b23d.pipeline.errors import SelectionError, reason
from b23d.pipeline.planning.hinting import hint


@dataclass(frozen=True)
class Selection:
    """What `--shape`, `--class`, `--limit`, `--stage`, `--until`, `--only-failed` and `--force` say; all must hold."""

    shapes: tuple[str, ...] = ()
    """`<class>/<id>`, a bare id, a glob over either (`chair/*`, `*-0003`), or `@FILE` with one of these a line."""
    classes: tuple[str, ...] = ()
    """Names or globs."""
    limit: int | None = None
    """Only each class's first N of the selected shapes."""
    stages: tuple[str, ...] = ()
    """Only these stages' tasks; what they need must be stored. Empty: all."""
    until: str | None = None
    """Up to this stage and no further."""
    only_failed: bool = False
    """Only shapes that failed before."""
    force: bool = False
    """Make the selected artifacts again although they are stored."""

    @classmethod
    def recorded(cls, told: Mapping[str, Any]) -> Selection:
        """What a record tells; fields that it does not know are as nothing was said."""
        known: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in told.items() if key in WORDS
        }
        return cls(**known)

    @property
    def words(self) -> str:
        """As the options that say it: `--shape chair/* --until extract`; "" where everything is selected."""
        said = []
        for key, option in WORDS.items():
            value = getattr(self, key)
            if isinstance(value, bool) or value is None:
                said += [option] * bool(value)
            else:
                said += [f"{option} {one}" for one in (value if isinstance(value, tuple) else (value,))]
        return " ".join(said)

    @property
    def narrows(self) -> bool:
        """Whether any target may be left out."""
        return bool(self.shapes or self.classes or self.only_failed or self.limit is not None)

    def targets(self, shapes: Sequence[Shape], failed: Collection[str] = ()) -> set[str]:
        """Names of the selected shapes. `failed`: names of the shapes that failed before.

        Raises SelectionError, naming the pattern, where one matches no shape or class.
        """
        patterns = list(_patterns(self.shapes))
        _check(patterns, [name for shape in shapes for name in (shape.name, shape.id)], "--shape")
        _check(self.classes, [shape.category for shape in shapes], "--class")
        chosen = [
            shape
            for shape in shapes
            if (not patterns or any(_matches(pattern, shape.name, shape.id) for pattern in patterns))
            and (not self.classes or any(_matches(pattern, shape.category) for pattern in self.classes))
            and (not self.only_failed or shape.name in failed)
        ]
        if self.limit is None:
            return {shape.name for shape in chosen}
        by_class: dict[str, list[str]] = defaultdict(list)
        for shape in chosen:
            by_class[shape.category].append(shape.name)
        return {name for names in by_class.values() for name in names[: self.limit]}

    def check_stages(self, known: Sequence[str]) -> None:
        """Raises SelectionError where `stages` or `until` names a stage that the run has not."""
        asked = [*self.stages, *([self.until] if self.until else [])]
        for name in asked:
            if name not in known:
                raise SelectionError(f"stage: expected one of {', '.join(known)}, got {name!r}; {hint(name, known)}")


EVERYTHING = Selection()
WORDS = {
    "shapes": "--shape",
    "classes": "--class",
    "limit": "--limit",
    "stages": "--stage",
    "until": "--until",
    "only_failed": "--only-failed",
    "force": "--force",
}
"""Field → the option that sets it."""


def _patterns(texts: Iterable[str]) -> Iterable[str]:
    for text in texts:
        if not text.startswith("@"):
            yield text
            continue
        path = Path(text[1:])
        try:
            lines = path.read_text(encoding="utf-8").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise SelectionError(
                f"--shape @{path}: expected a text file with a shape a line, got {reason(error)}"
            ) from error
        yield from (line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#"))


def _matches(pattern: str, *names: str) -> bool:
    """Names with brackets match themselves although brackets mean a set in a glob."""
    return any(name == pattern or fnmatchcase(name, pattern) for name in names)


def _check(patterns: Iterable[str], names: Sequence[str], option: str) -> None:
    for pattern in patterns:
        if not any(_matches(pattern, name) for name in names):
            near = hint(pattern, names)
            raise SelectionError(f"{option}: expected a name or glob of the data set, got {pattern!r}; {near}")
