"""The text of a first run file for a folder that `survey` has looked at."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any

from b23d.schemas.wording import counted
from b23d.stages.datasets.survey import Survey

SHOTS = 3
"""As many annotated shapes as the method's paper takes; fewer where fewer are annotated."""

TEXT = """\
# {found}
# Written by `b23d init`; every field there is: `b23d params`.
name = {name}

[dataset]
kind = {kind}
root = {root}   # relative to this file
{settings}
[shots]
count = {count}     # annotated shapes of each class that teach the others
draws = [0]   # one choice of shots; [0, 1, 2, 3, 4] takes five in turn, and scores get a spread
# ids = {{ {example} = ["…", "…"] }}   # or name the shots of a class yourself

[stages.extract]
# encoder = "dinov2-small"   # better, where there is network; the default's weights come along
{scoring}"""
SCORING = """
[stages.score]
units = "unit"   # thresholds are shares of a shape's longest side; "dataset": in the files' units, as benchmarks count
"""
"""Of a folder of one's own, whose shapes may have any size; data sets of known layouts are scored as published."""


def run_file_text(found: Survey, name: str, beside: Path) -> str:
    """The run file's text. `beside`: the folder it will lie in."""
    root = Path(os.path.relpath(found.dataset.model_dump()["root"], beside.resolve())).as_posix()
    lines = {key: f"{key} = {_toml(value)}\n" for key, value in found.settings.items()}
    if up := up_setting(found):
        lines["up"] = f"up = {up}   # what most shapes looked at stand on; look at one\n"
    return TEXT.format(
        found=summary(found),
        name=_toml(name),
        kind=_toml(found.dataset.kind),
        root=_toml(root),
        settings="".join(lines.values()),
        count=shots(found),
        example=_toml(found.classes[0].name),
        scoring=SCORING if found.dataset.kind == "folder" else "",
    )


def up_setting(found: Survey) -> str:
    """`dataset.up` as TOML writes it, by the classes that tell: for all alike, or a table; "" where +y is up."""
    told = {each.name: each.up.axis for each in found.classes if each.up is not None and each.up.axis is not None}
    tipped = {name: axis for name, axis in told.items() if axis != "y"}
    if not tipped:
        return ""
    if len(set(told.values())) == 1 and 2 * len(told) >= len(found.classes):
        return _toml(next(iter(tipped.values())))
    return "{ " + ", ".join(f"{_toml(name)} = {_toml(axis)}" for name, axis in tipped.items()) + " }"


def summary(found: Survey) -> str:
    """What was found, in one line."""
    shapes, classes = found.shapes, len(found.classes)
    formats = sorted({suffix for each in found.classes for suffix in each.formats})
    annotated = f"{found.annotated} annotated" if found.annotated else "none annotated yet"
    return (
        f"{counted(shapes, 'shape')} of {counted(classes, 'class')} ({', '.join(s[1:] for s in formats)}), {annotated}"
    )


def shots(found: Survey) -> int:
    """How many shots every annotated class can give, while it leaves a shape to predict."""
    having = [(len(each.annotated), each.shapes) for each in found.classes if each.annotated]
    return max(1, min([SHOTS, *(min(annotated, shapes - 1) for annotated, shapes in having)]))


def run_name(folder: Path) -> str:
    """A run's name after a folder's: letters, digits, dots, dashes and underscores."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", folder.resolve().name).strip("-._") or "shapes"


def _toml(value: Any) -> str:
    """A string, number or list as TOML writes it: JSON's form is one of TOML's."""
    return json.dumps(value, ensure_ascii=False)
