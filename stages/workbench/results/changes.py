"""From one setting of the stages to another, one field at a time."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from b23d.pipeline.config import Config
from b23d.pipeline.members import Member


@dataclass(frozen=True)
class Change:
    """One step: one field."""

    field: str
    old: Any
    new: Any

    def __str__(self) -> str:
        return f"{self.field.removeprefix('stages.')}: {_plain(self.old)} → {_plain(self.new)}"


def changes(
    origin: Config, goal: Config, stages: Iterable[str], detours: Config, via: Sequence[str], fixed: Sequence[str]
) -> list[Change]:
    """The steps from `origin` to `goal`: detours' first halves, then field by field in dataflow order, then detours'
    second halves.

    stages: in dataflow order; others stay. detours: `origin` with the values of the fields `via`, of which only those
    that differ between origin and goal are taken. fixed: fields that stay whatever the two say.
    """
    differ: dict[str, tuple[Any, Any]] = {}
    for stage in stages:
        if stage in origin.params and stage in goal.params:
            old, new = origin.params[stage].hashed(), goal.params[stage].hashed()
            differ |= {f"stages.{stage}.{key}": (old[key], new[key]) for key in old if old[key] != new[key]}
    differ = {
        field: pair for field, pair in differ.items() if not any(field == f or f.startswith(f"{field}.") for f in fixed)
    }
    middle = {field: _at(detours, field) for field in via if field in differ}
    out = [Change(field, differ[field][0], value) for field, value in middle.items()]
    straight = [Change(field, old, new) for field, (old, new) in differ.items() if field not in middle]
    back = [Change(field, value, differ[field][1]) for field, value in middle.items()]
    return [change for change in (*out, *straight, *back) if change.old != change.new]


def members(origin: str, steps: Sequence[Change], name: str) -> list[Member]:
    """The run before the first step, and that after each."""
    state: dict[str, Any] = {}
    for change in steps:
        state.setdefault(change.field, change.old)
    found = [Member(origin, _overrides(state, name))]
    for change in steps:
        state[change.field] = change.new
        found.append(Member(str(change), _overrides(state, name)))
    return found


def _overrides(state: dict[str, Any], name: str) -> tuple[str, ...]:
    return (*(f"{field}={json.dumps(value)}" for field, value in state.items()), f"name={name}")


def _at(config: Config, field: str) -> Any:
    _, stage, key = field.split(".", 2)
    return config.params[stage].hashed()[key]


def _plain(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
