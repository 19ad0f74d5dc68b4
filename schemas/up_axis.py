"""Which axis of a file points up, and the rotation that brings it to +y.

| up | what becomes of (x, y, z) |
|---|---|
| `y` | (x, y, z): as it is |
| `z` | (x, z, -y): the right stays, the old front (-y) becomes +z, as programs export z-up shapes to y-up ones |
| `-z` | (x, -z, y): the right stays |
| `x` | (-y, x, z): the front stays |
| `-x` | (y, -x, z): the front stays |
| `-y` | (-x, -y, z): the front stays |
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from difflib import get_close_matches
from fnmatch import fnmatchcase
from typing import Annotated, Any, Literal, get_args

import numpy as np
from pydantic import BeforeValidator

UpAxis = Literal["y", "z", "x", "-x", "-y", "-z"]
UpChoice = Literal["y", "z", "x", "-x", "-y", "-z", "auto"]
"""`auto`: each shape's own, found by the stage `orient`."""
UP_AXES: tuple[UpAxis, ...] = get_args(UpAxis)
_ROWS = {
    "y": ("x", "y", "z"),
    "z": ("x", "z", "-y"),
    "-z": ("x", "-z", "y"),
    "x": ("-y", "x", "z"),
    "-x": ("y", "-x", "z"),
    "-y": ("-x", "-y", "z"),
}


def to_y_up(up: UpAxis) -> np.ndarray:
    """(3, 3) float64: the rotation (determinant 1) that brings the axis `up` to +y; exact, entries are 0 and ±1."""
    rotation = np.zeros((3, 3))
    for row, old in enumerate(_ROWS[up]):
        rotation[row, "xyz".index(old[-1])] = -1.0 if old[0] == "-" else 1.0
    return rotation


def _checked(value: Any) -> Any:
    """Raises ValueError where it is neither an axis nor a table of them."""
    for where, axis in value.items() if isinstance(value, dict) else [("", value)]:
        if axis not in get_args(UpChoice):
            beside = "" if where else ", or a table of class or shape → axis"
            place = f"up.{where}" if where else "up"
            raise ValueError(
                f"{place}: expected one of {', '.join(get_args(UpChoice))}{beside}, got {axis!r}; mend the value"
            )
    return value


Up = Annotated[UpChoice | dict[str, UpChoice], BeforeValidator(_checked)]
"""An axis for all shapes, or a table: a class, a shape (`<class>/<id>`), or a pattern of shapes (`chair/old-*`, `*`) →
axis; what is nowhere in it has `y`."""


def axes_of(
    up: UpChoice | Mapping[str, UpChoice], shapes: Collection[tuple[str, str]]
) -> dict[tuple[str, str], UpChoice]:
    """The choice for each shape (class, id). The most specific key that fits wins: a shape's name, then the pattern
    with most letters of its own; a class stands for the pattern `<class>/*`.

    Raises ValueError: a key that fits no shape; two keys that are as specific and disagree about a shape.
    """
    if isinstance(up, str):
        return dict.fromkeys(shapes, up)
    found: dict[tuple[str, str], UpChoice] = {}
    used: set[str] = set()
    for category, one in shapes:
        fitting = [(_specific(key, category, one), key) for key in up if _fits(key, category, one)]
        used |= {key for _, key in fitting}
        best = [key for rank, key in fitting if rank == max(fitting)[0]]
        if len({up[key] for key in best}) > 1:
            told = " and ".join(f"{key} = {up[key]}" for key in sorted(best))
            raise ValueError(f"dataset.up: expected one axis for {category}/{one}, got {told}; leave one out")
        found[category, one] = up[best[0]] if best else "y"
    if unknown := sorted(set(up) - used):
        known = sorted({category for category, _ in shapes} | {"/".join(shape) for shape in shapes})
        near = get_close_matches(unknown[0], known, 1)
        classes = ", ".join(sorted({category for category, _ in shapes})[:8])
        hint = f"did you mean {near[0]!r}?" if near else f"its classes are {classes}"
        raise ValueError(
            f"dataset.up: expected classes, shapes or patterns of the data set, got {unknown[0]!r}; {hint}"
        )
    return found


def _fits(key: str, category: str, one: str) -> bool:
    name = f"{category}/{one}"
    return key in (category, name) or fnmatchcase(name, key)


def _specific(key: str, category: str, one: str) -> int:
    """How specific a key that fits is: letters that are its own; a name in full above all."""
    if key == f"{category}/{one}":
        return 1_000_000
    if key == category:
        return len(key) + 1
    return sum(letter not in "*?[]" for letter in key)
