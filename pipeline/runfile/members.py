"""The runs that a run file's `[sweep]` and `[variants]` ask for: the file itself with a few fields set, one run
each."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any

from b23d.pipeline.runfile.checking import Where
from b23d.pipeline.runfile.config import Config
from b23d.pipeline.runfile.overrides import Carried, Listed

SUFFIX = ".sweep"
"""Of the name, and so of the folder, of every member; addresses do not know it."""
VARIANTS = "variants"


@dataclass(frozen=True)
class Member:
    """One run of a series: what to call it, and what sets it apart."""

    label: str
    overrides: tuple[str, ...]
    series: str = ""
    """What its table is called: the swept field, or "variants"."""
    own: tuple[str, ...] = ()
    """Of `overrides`, those that no other member has."""


def members(config: Config) -> list[Member]:
    """The members of a run file, in its order, over the config's own overrides; none where it has neither table."""
    name = f"name={config.file.name}{SUFFIX}"
    given = tuple(map(Carried, config.overrides))
    found, place = [], Where(config.path, "", config.overrides)
    for field, values in config.file.sweep.items():
        for value in map(_json, values):
            own = Listed(f"{field}={value}", place.table("sweep").of(field))
            found.append(Member(f"{field} = {value}", (*given, own, name), field, (own,)))
    for variant, fields in config.file.variants.items():
        where = place.table(f"{VARIANTS}.{variant}").of("")
        sets = tuple(Listed(f"{field}={_json(value)}", where) for field, value in fields.items())
        found.append(Member(variant, (*given, *sets, name), VARIANTS, sets))
    return found


def _json(value: Any) -> str:
    """As `--set` takes it; TOML's dates and times as texts."""
    return json.dumps(value, default=str)
