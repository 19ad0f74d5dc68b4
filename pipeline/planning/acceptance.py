"""Acceptance: "the new version of this stage gives the same, by my word". Links without recomputing, until revoked.

A note in the store, `.accepted/<stage>-<version>.json`, names the older versions that are taken for a version of a
stage. A plan then finds artifacts that the older version made of the same inputs with the same parameters, as if the
new one had made them. Addresses do not know of it: what is made below stays where it would be, and says in its
provenance on whose word it rests.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass

from b23d.pipeline.stage import Stage
from b23d.pipeline.storage.marker import names
from b23d.pipeline.storage.notes import put_note
from b23d.pipeline.store import Store

FOLDER = ".accepted"


@dataclass(frozen=True)
class Acceptance:
    stage: str
    version: int
    takes: tuple[int, ...]
    """Older versions, the newest first."""
    checked: int
    """How many artifacts were made anew and found the same before."""
    when: str


def accept(store: Store, stage: str, version: int, takes: Iterable[int], checked: int) -> None:
    """Take older versions of a stage for `version`. Raises StoreError."""
    when = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime())
    told = {"takes": sorted(takes, reverse=True), "checked": checked, "when": when}
    put_note(store, _name(stage, version), json.dumps(told).encode())


def revoke(store: Store, stage: str, version: int) -> bool:
    """Take it back; False: there was none."""
    try:
        store.fs.rm_file(f"{store.root}/{_name(stage, version)}")
    except FileNotFoundError:
        return False
    return True


def acceptances(store: Store) -> list[Acceptance]:
    """All of a store; one that cannot be read counts for nothing: then things are made anew."""
    found = []
    for name in names(store.fs, f"{store.root}/{FOLDER}"):
        stage, _, version = name.removesuffix(".json").rpartition("-")
        with suppress(OSError, ValueError, KeyError, TypeError, RecursionError):
            told = json.loads(store.fs.cat_file(f"{store.root}/{FOLDER}/{name}"))
            takes = tuple(int(taken) for taken in told["takes"])
            found.append(Acceptance(stage, int(version), takes, int(told["checked"]), str(told["when"])))
    return found


def versions_accepted(store: Store, stages: Mapping[str, Stage]) -> dict[str, tuple[int, ...]]:
    """Stage → older versions that are taken for the installed one."""
    return {a.stage: a.takes for a in acceptances(store) if a.stage in stages and stages[a.stage].version == a.version}


def _name(stage: str, version: int) -> str:
    return f"{FOLDER}/{stage}-{version}.json"
