"""A task's peak memory is its own, not that of what the process did before."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from b23d.pipeline.scheduling import memory
from b23d.pipeline.scheduling.memory import peak_mb, reset_peak

MB = 2**20


def test_a_small_task_after_a_large_one_has_a_small_peak() -> None:
    try:
        (memory.PROC / "clear_refs").write_text("5")
    except OSError:
        pytest.skip("needs a /proc that may be written")
    reset_peak()
    before = peak_mb()
    large = np.ones(256 * MB, np.uint8)
    del large
    at_most = peak_mb()
    assert 200 < at_most - before < 300
    reset_peak()
    assert peak_mb() < at_most - 200


def test_where_there_is_no_proc_it_is_what_the_system_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    known = peak_mb()
    monkeypatch.setattr(memory, "PROC", tmp_path / "none")
    reset_peak()
    assert peak_mb() >= 0.9 * known
    (tmp_path / "none").mkdir()
    (tmp_path / "none" / "status").write_text("Name: x\nVmHWM:\t  2048 kB\n")
    assert peak_mb() == 2
