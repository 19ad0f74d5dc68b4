"""What a plan would cost, from the measured history of the store."""

from __future__ import annotations

from collections import Counter
from typing import Any

from b23d.pipeline.plan import Plan, State
from b23d.pipeline.run import Run


def project(run: Run, plan: Plan) -> dict[str, dict[str, Any]]:
    """Per stage: run, cached and blocked counts, how many of those to run stand behind others and may be spared, and
    the bytes and CPU seconds that running would take.

    bytes and seconds are None where something is to run and the stage has never run in this store. Transient stages
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
            "transient": transient,
        }
    return rows
