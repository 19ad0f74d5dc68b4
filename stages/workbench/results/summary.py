"""What run this is: its data set, draws, settings that differ from the defaults, versions, and what each stage cost."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable
from typing import Any

import numpy as np
from pydantic_core import PydanticUndefined

from b23d.pipeline.errors import B23dError
from b23d.pipeline.planning.nodes import State
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.run import Run
from b23d.schemas.params import Params


def settings(run: Run) -> list[dict[str, Any]]:
    """Every field of every stage's Params that counts: where, value, default, whether they differ, and what it
    means."""
    tables: list[tuple[str, Params]] = [("shots", run.config.file.shots)]
    tables += [(f"stages.{name}", params) for name, params in run.config.params.items()]
    return [line for where, params in tables for line in _fields(where, params)]


def _fields(where: str, params: Params) -> Iterable[dict[str, Any]]:
    for option in params.options():
        if not option.counts:
            continue
        value, field, default = option.value, option.field, option.field.get_default(call_default_factory=True)
        required = default is PydanticUndefined
        yield {
            "key": f"{where}.{option.name}",
            "value": _text(value),
            "default": "" if required else _text(default),
            "differs": not required and value != default,
            "means": " ".join((field.description or "").split()),
        }


def dataset_fields(run: Run) -> dict[str, str]:
    """The `[dataset]` table as it was understood."""
    return {name: _text(value) for name, value in run.config.dataset.model_dump(mode="json").items()}


def costs(run: Run, plan: Plan) -> list[dict[str, Any]]:
    """Per stage: artifacts made, waiting and blocked, seconds and bytes in this run, by measured history, else by
    provenance."""
    transient = set(run.config.file.store.transient)
    addresses: dict[str, set[str]] = defaultdict(set)
    counts: dict[str, Counter[State]] = plan.count()
    for node in plan.nodes.values():
        if node.state is State.CACHED:
            addresses[node.stage].add(node.address)
    return [_cost(run, stage, addresses[stage], counts[stage], stage in transient) for stage in plan.stages]


def _cost(run: Run, stage: str, addresses: set[str], counts: Counter[State], transient: bool) -> dict[str, Any]:
    known = {address: (s, b, peak) for address, s, b, peak in run.index.history(stage) if address in addresses}
    for address in addresses - known.keys():  # another store's index was lost, or the artifact came from elsewhere
        try:
            head = run.store.head(stage, address)
            made = head.provenance
            known[address] = (float(made.get("seconds") or 0), head.stored_bytes, float(made.get("peak_mb") or 0))
        except B23dError:
            continue
    seconds, stored, peaks = (
        (np.array(column, np.float64) for column in zip(*known.values(), strict=True)) if known else (np.zeros(0),) * 3
    )
    return {
        "stage": stage,
        "version": run.config.stages[stage].version,
        "transient": transient,
        "made": len(addresses),
        "waiting": counts[State.RUN],
        "blocked": counts[State.BLOCKED],
        "seconds": float(seconds.sum()),
        "median": float(np.median(seconds)) if len(seconds) else 0.0,
        "p95": float(np.percentile(seconds, 95)) if len(seconds) else 0.0,
        "slowest": float(seconds.max(initial=0)),
        "bytes": float(stored.sum()),
        "bytes_each": float(stored.mean()) if len(stored) else 0.0,
        "peak_mb": float(peaks.max(initial=0)),
    }


def origins(run: Run, plan: Plan, sampled: int = 40) -> dict[str, list[str]]:
    """Versions, device and code commit that made this run's artifacts, by a sample of each stage's; several where they
    differ."""
    found: dict[str, set[str]] = defaultdict(set)
    for stage in plan.stages:
        made = [node for node in plan.nodes.values() if node.stage == stage and node.state is State.CACHED]
        for node in made[:: max(1, len(made) // sampled)]:
            try:
                provenance = run.store.head(stage, node.address).provenance
            except B23dError:
                continue
            for name, version in (provenance.get("versions") or {}).items():
                found[name].add(str(version))
            for name in ("device", "code"):
                if provenance.get(name):
                    found[name].add(str(provenance[name]))
    return {name: sorted(values) for name, values in found.items()}


def _text(value: Any) -> str:
    if isinstance(value, str):
        return value
    if isinstance(value, bool) or value is None:
        return str(value).lower() if value is not None else "none"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_text(item) for item in value) + "]"
    return str(value)
