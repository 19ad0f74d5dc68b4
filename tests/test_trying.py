"""One task alone: the same result as a run's, nothing stored, and what differs is named."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from b23d.pipeline.inspection.comparing import differences
from b23d.pipeline.inspection.trying import attempt
from b23d.pipeline.run import Run
from tests.toy import Numbers, make_toy


def files(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if "index" not in path.name}


def test_a_trial_gives_what_a_run_stored_and_stores_nothing(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)
    before = files(tmp_path)
    run = Run.load(path)
    trial = attempt(run, run.plan().draws[0].targets[0].name, "add")
    assert trial.stored and not trial.differences and not trial.made
    assert files(tmp_path) == before


def test_inputs_that_are_not_stored_are_made_in_memory(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    trial = attempt(Run.load(path), "toy/s0", "shift")
    assert trial.made == ["square of toy/s0"] and not trial.stored
    np.testing.assert_array_equal(trial.artifact.values, np.arange(4.0) ** 2 + 1)  # type: ignore[attr-defined]
    assert not list(tmp_path.glob("store/shift/*"))


def test_what_a_changed_function_gives_is_compared_with_what_is_stored(tmp_path: Path) -> None:
    path = make_toy(tmp_path)
    Run.load(path).execute(workers=0)

    def doubled(function: Any, **arguments: Any) -> Numbers:
        given = function(**arguments)
        return Numbers(values=given.values * 2)

    trial = attempt(Run.load(path), "toy/s3", "shift", call=doubled)
    assert [found.name for found in trial.differences] == ["values"]
    assert "4 of 4 differ, at most by 37" in trial.differences[0].how  # (3 + 3)² + 1


def one(values: list[float], note: str = "", grid: bool = False) -> Numbers:
    zeros = np.zeros((1, len(values)), np.float32)
    return Numbers(values=np.array(values, float), note=note, grid=zeros if grid else None)


@pytest.mark.parametrize(
    ("now", "before", "expected"),
    [
        (one([1, 2]), one([1, 2]), []),
        (one([1, np.nan]), one([1, np.nan]), []),
        (one([1, 2]), one([1, 2, 3]), ["values: float64 (2,), was float64 (3,)"]),
        (one([1, 2.5]), one([1, 2]), ["values: 1 of 2 differ, at most by 0.5 (at [1]: 2.5, was 2)"]),
        (one([1], "a"), one([1], "b"), ["note: 'a', was 'b'"]),
        (one([1], grid=True), one([1]), ["grid: there, was absent"]),
    ],
)
def test_differences_name_the_array_and_how_much(now: Numbers, before: Numbers, expected: list[str]) -> None:
    assert [str(found) for found in differences(now, before)] == expected


def test_artifacts_of_other_schemas_are_not_compared() -> None:
    class Other(Numbers):
        pass

    with pytest.raises(TypeError, match="expected two of one schema"):
        differences(one([1]), Other(values=np.zeros(1)))
