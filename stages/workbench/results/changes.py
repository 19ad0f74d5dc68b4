"""From one setting of the stages to another, one field at a time."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from b23d.pipeline.inspection.change import Change
from b23d.pipeline.runfile.config import Config
from b23d.pipeline.runfile.members import Member
from b23d.pipeline.runfile.overrides import Carried
from b23d.schemas.params import flat


@dataclass(frozen=True)
class Way:
    """From one setting to another."""

    start: dict[str, Any]
    """Every field that differs, as the first setting has it, those of methods that are only chosen later included."""
    steps: list[Change]


def way(
    origin: Config,
    goal: Config,
    stages: Iterable[str],
    detours: Sequence[Config],
    via: Sequence[str],
    fixed: Sequence[str],
) -> Way:
    """Detours' first halves, then field by field in dataflow order what counts between them, then detours' second
    halves, then what counts only where these lead.

    stages: in dataflow order; others stay. detours: `origin` and `goal` with the values of the fields `via`, of which
    only those that differ between origin and goal are taken. fixed: fields that stay whatever the two say.
    """
    both = [stage for stage in stages if stage in origin.params and stage in goal.params]
    old, new = _values(origin, both), _values(goal, both)
    differ = [name for name in old if old[name] != new[name] and name not in fixed]
    there = _values(detours[0], both)
    middle = [name for name in via if name in differ]
    between = set().union(*(_counting(config, both) for config in (detours if middle else (origin, goal))))
    after = _counting(goal, both)
    out = [Change(name, old[name], there[name]) for name in middle]
    straight = [Change(name, old[name], new[name]) for name in differ if name in between and name not in middle]
    back = [Change(name, there[name], new[name]) for name in middle]
    late = [Change(name, old[name], new[name]) for name in differ if name in after - between and name not in middle]
    steps = [change for change in (*out, *straight, *back, *late) if change.old != change.new]
    return Way({name: old[name] for name in differ}, steps)


def members(origin: str, found: Way, name: str) -> list[Member]:
    """The run before the first step, and that after each."""
    state = dict(found.start)
    listed = [Member(origin, _overrides(state, name))]
    for change in found.steps:
        state[change.field] = change.new
        listed.append(Member(change.step, _overrides(state, name)))
    return listed


def _overrides(state: dict[str, Any], name: str) -> tuple[str, ...]:
    return (*(Carried(f"{field}={json.dumps(value)}") for field, value in state.items()), f"name={name}")


def _values(config: Config, stages: Iterable[str]) -> dict[str, Any]:
    """Dotted name → value of every field that may enter an address, whether it counts or not."""
    dumped = {stage: flat(config.params[stage].model_dump(mode="json")) for stage in stages}
    return {
        f"stages.{stage}.{option.name}": dumped[stage][option.name]
        for stage in stages
        for option in config.params[stage].options()
        if not option.unhashed
    }


def _counting(config: Config, stages: Iterable[str]) -> set[str]:
    return {
        f"stages.{stage}.{option.name}"
        for stage in stages
        for option in config.params[stage].options()
        if option.counts
    }
