"""What a plan would cost, from the measured history of the store."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path
from typing import Any

from b23d.pipeline.planning.nodes import State
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.run import Run
from b23d.schemas.runfile import Execution


def project(run: Run, plan: Plan) -> dict[str, dict[str, Any]]:
    """Per stage: run, cached and blocked counts, how many of those to run stand behind others and may be spared, and
    the bytes and CPU seconds that running would take.

    `peak_mb`: the highest peak of a worker's memory. bytes, seconds and peak are None where something is to run and
    the stage has never run in this store. Transient stages
    count as run when a task to run computes them; they store nothing, and their seconds are part of their consumers'.
    """
    counts, inlined, costs = plan.count(), plan.inlined(), run.index.costs()
    behind = Counter(node.stage for node in plan.to_run() if node.behind)
    rows = {}
    for stage in plan.stages:
        transient = stage in run.config.file.store.transient
        count = inlined[stage] if transient else counts[stage][State.RUN]
        cost = costs.get(stage)
        known = count == 0 or transient
        rows[stage] = {
            "run": count,
            "cached": counts[stage][State.CACHED],
            "blocked": counts[stage][State.BLOCKED],
            "behind": behind[stage],
            "bytes": 0 if known else round(count * cost.bytes) if cost else None,
            "seconds": 0.0 if known else round(count * cost.seconds, 2) if cost else None,
            "peak_mb": 0.0 if known else round(cost.peak_mb, 1) if cost else None,
            "transient": transient,
        }
    return rows


def memory_line(stages: dict[str, dict[str, Any]], options: Execution) -> str | None:
    """What the projected peak means on this machine; None: nothing is known of what is to run."""
    peak, stage = max(((row["peak_mb"] or 0.0, stage) for stage, row in stages.items()), default=(0.0, ""))
    free = free_mb()
    if not peak or free is None:
        return None
    wanted, fit = options.workers or os.cpu_count() or 1, int(free // peak)
    line = f"memory: up to {peak:,.0f} MB a worker ({stage}); {free:,.0f} MB are free here, enough for {fit} workers"
    if options.scheduler:
        return line
    if peak > options.memory_gb * 1024:
        return f"{line}; a worker may have {options.memory_gb * 1024:,.0f} MB: raise execution.memory_gb"
    return f"{line}; too few for {wanted}: --workers {max(fit, 1)}" if fit < wanted else line


def free_mb() -> float | None:
    """Memory that programs may still take, in MB; None where the system does not say (it is Linux that does)."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        return int(next(line for line in lines if line.startswith("MemAvailable")).split()[1]) / 1024
    except (OSError, StopIteration):
        return None
