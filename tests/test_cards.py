"""GPUs of this machine: who works on them. No GPU is needed to see it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from b23d.pipeline.run import Run
from tests.toy import make_toy


def test_several_processes_share_a_card(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """They alone see it and offer it; a stage that needs one runs there."""
    import distributed

    started: dict[str, dict] = {}
    real = distributed.SpecCluster

    def recorded(workers: dict, **options: Any) -> Any:
        started.update(workers)
        return real(workers=workers, **options)

    monkeypatch.setattr(distributed, "SpecCluster", recorded)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "7")
    run = Run.load(make_toy(tmp_path), ['outputs=["needs_gpu", "shift"]', "execution.processes_per_gpu=2"])
    assert run.execute(workers=1).ok
    seen = {name: worker["options"]["env"]["CUDA_VISIBLE_DEVICES"] for name, worker in started.items()}
    assert seen == {"cpu-0": "", "gpu-7-0": "7", "gpu-7-1": "7"}
    offered = {name for name, worker in started.items() if worker["options"].get("resources") == {"gpu": 1}}
    assert offered == {"gpu-7-0", "gpu-7-1"}
