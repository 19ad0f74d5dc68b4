"""What stages found odd and let pass, kept beside a run's records: told at the end of the run, and by later plans.

A stage warns by a field `warnings: list[str]` of what it gives; what is seen of several artifacts together is added.
The file is a cache: losing it silences old warnings.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from b23d.pipeline.planning.plan import Plan

if TYPE_CHECKING:
    from b23d.pipeline.scheduling.tasks import Outcome

FILE = "warnings.json"


def remember(folder: Path, done: Iterable[Outcome]) -> None:
    """Add these outcomes' warnings to those of the run's folder."""
    new = {outcome.address: list(outcome.warnings) for outcome in done}
    kept = {address: lines for address, lines in _read(folder).items() if address not in new}
    found = {**kept, **{address: lines for address, lines in new.items() if lines}}
    if found or (folder / FILE).exists():
        _write(folder, found)


def remember_lines(folder: Path, found: Mapping[str, list[str]]) -> None:
    """Add lines about what was seen of several artifacts together, each under the address of one of them."""
    old = _read(folder)
    if new := {address: [*old.get(address, []), *lines] for address, lines in found.items()}:
        _write(folder, {**old, **new})


def warnings(folder: Path, plan: Plan) -> list[str]:
    """The warnings of what a plan reaches, sorted, each once."""
    reached = {address for _, address in plan.nodes}
    return sorted({line for address, lines in _read(folder).items() if address in reached for line in lines})


def _write(folder: Path, found: Mapping[str, list[str]]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    aside = folder / f".{FILE}.part"
    aside.write_text(json.dumps(found, indent=1))
    aside.replace(folder / FILE)


def _read(folder: Path) -> dict[str, list[str]]:
    with suppress(OSError, ValueError):
        found = json.loads((folder / FILE).read_text())
        return found if isinstance(found, dict) else {}
    return {}
