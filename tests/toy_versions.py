"""A toy stage of another version, and what then runs."""

from __future__ import annotations

from dataclasses import replace

import pytest

from b23d.pipeline.run import Run
from b23d.pipeline.stage import STAGES


def bump(monkeypatch: pytest.MonkeyPatch, name: str, version: int, function: object = None) -> None:
    stage = STAGES[name]
    monkeypatch.setitem(
        STAGES,
        name,
        replace(stage, version=version, function=function or stage.function),  # type: ignore[arg-type]
    )


def ran(run: Run) -> dict[str, int]:
    report = run.execute(workers=0)
    assert report.ok
    stages = [outcome.stage for outcome in report.done]
    return {stage: stages.count(stage) for stage in dict.fromkeys(stages)}


def contents(run: Run) -> dict[tuple[str, str, int | None], str]:
    return {key: run.store.head(node.stage, node.address).content for key, node in run.plan().by_shape.items()}
