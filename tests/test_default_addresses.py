"""The addresses of defaults: which had to change when options moved to their methods, and why.

`default_addresses.json` holds every stage's version and hashed defaults as they were before (commit ad8747c). A stage
has the same address at its defaults still, or stands in `CHANGED` with what asked for another. What users have stored
is found again only where the address stayed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from b23d.pipeline.address import StageAddress
from b23d.pipeline.stage import load_stages

BEFORE: dict[str, dict[str, Any]] = json.loads((Path(__file__).parent / "default_addresses.json").read_text())
CHANGED = {
    "apply_head": "version 2: predictions say how sure they are; `apart` renamed `separation`",
    "backproject": "`depth_tolerance` moved into the table of the visibility that uses it",
    "calibrate": "the options of iss, harris and sift moved into their tables: under farthest none changed anything",
    "describe": "the options of hks, wks and shot moved into their tables",
    "extract": "version 2: only tokens of the foreground are made and stored; `tokens` is new",
    "geodesic": "version 3: components are joined all along the gaps between them; landmarks stand for more than 8,192 "
    "candidates; the options moved into the methods' tables",
    "import_predictions": "`spacing` and `origin` moved into the table of the one format that uses them",
    "normalize": "version 5: stray points and specks are left out, and `stray` is new; clouds of over 4,096 points are "
    "sampled, it was 8,192; concave polygons, glTF and text files are read otherwise; `watertight_resolution` dropped "
    "where nothing is made watertight",
    "optimize": "version 13: it takes what `learn` has made of the shots, once a draw, and leaves it the options that "
    "concern the shots; predictions say how probable it is that they are right; places come from the shots most alike, "
    "laid over the target as a whole and then around each keypoint; "
    "where the surface lies, and how it differs from itself turned half round, tells a front; so is a target searched "
    "that clearly stands otherwise than shots that stand alike; copies of a shot do not tell how much a class differs; "
    "what is absent is told by how little what is found looks like it",
    "render": "version 3: of a cloud's points at one place one is drawn, of over 100,000 some; `rings` and "
    "`count` moved into "
    "the layouts' tables",
    "score": "version 2: `either_front` is new; symmetries turn about the axis that points up in the file",
    "train_head": "`hidden` and its `seed` moved into the table of the detector with a hidden layer",
}
"""Stage → why its address at the defaults is another than before."""
NEW = {"annotation", "learn", "orient", "stand"}
"""Stages that were not there before."""


def addresses_now() -> dict[str, str]:
    """Of each stage of the project at its defaults, without inputs."""
    return {
        name: StageAddress(name, one.version, one.params().hashed())({})
        for name, one in load_stages().items()
        if one.function.__module__.startswith("b23d.")
    }


def addresses_before() -> dict[str, str]:
    return {name: StageAddress(name, one["version"], one["params"])({}) for name, one in BEFORE.items()}


def faults(
    before: Mapping[str, str], now: Mapping[str, str], changed: Mapping[str, str], new: set[str]
) -> dict[str, str]:
    """Stage → what is wrong with what is said of it."""
    found = {}
    for name in before.keys() | now.keys() | changed.keys() | new:
        if name not in now:
            found[name] = "is not there any more"
        elif name not in before:
            if name not in new:
                found[name] = "is new: add it to NEW"
        elif name in new:
            found[name] = "was there before: take it out of NEW"
        elif before[name] != now[name] and not changed.get(name, "").strip():
            found[name] = "has another address at its defaults: undo that, or say in CHANGED what asked for it"
        elif before[name] == now[name] and name in changed:
            found[name] = "has the address that it had: take it out of CHANGED"
    return found


def test_a_default_address_stays_or_says_why_not() -> None:
    assert faults(addresses_before(), addresses_now(), CHANGED, NEW) == {}


@pytest.mark.parametrize("name", sorted(CHANGED))
def test_a_reason_names_the_version_that_was_raised_and_only_that(name: str) -> None:
    version = load_stages()[name].version
    assert CHANGED[name].startswith(f"version {version}:") == (version != BEFORE[name]["version"])


def test_every_kind_of_fault_is_found() -> None:
    before = {"same": "1", "moved": "1", "told": "1", "idle": "1", "gone": "1", "old": "1"}
    now = {"same": "1", "moved": "2", "told": "2", "idle": "1", "fresh": "1", "known": "1", "old": "1"}
    found = faults(before, now, {"told": "a reason", "idle": "a reason"}, {"known", "old"})
    assert set(found) == {"moved", "idle", "gone", "fresh", "old"}
