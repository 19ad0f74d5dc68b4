"""What shots teach is learned once for all targets, and anew as soon as anything that it depends on is another."""

from __future__ import annotations

import gc
from collections.abc import Sequence

import numpy as np
import pytest

from b23d.schemas.artifact import Artifact
from b23d.stages.optimize import OptimizeParams, optimize
from b23d.stages.solvers import remembering
from b23d.stages.solvers.posterior.options import PosteriorParams
from b23d.stages.solvers.remembering import once
from b23d.stages.solvers.shots import Shot, labelled
from tests.test_posterior import Parts, box_cloud

PARAMS = PosteriorParams()


def shots_of(parts: Sequence[Parts]) -> list[Shot]:
    return labelled(*(list(column) for column in zip(*parts, strict=True)))


def stored(seed: int) -> Parts:
    """As a worker keeps it for all targets."""
    shape, features, distances, keypoints = box_cloud(seed)
    return shape.locked(), features.locked(), distances.locked(), keypoints


class Counted:
    """Gives a new object each time it is asked."""

    def __init__(self) -> None:
        self.times = 0

    def __call__(self, shots: Sequence[Shot], params: PosteriorParams) -> int:
        self.times += 1
        return self.times


@pytest.fixture
def make() -> Counted:
    remembering._kept.clear()
    return Counted()


def test_the_same_shots_are_learned_from_once(make: Counted) -> None:
    parts = [stored(i) for i in range(2)]
    assert [once(make, shots_of(parts), PARAMS) for _ in range(3)] == [1, 1, 1]


def test_all_that_it_depends_on_counts(make: Counted) -> None:
    parts = [stored(i) for i in range(2)]
    once(make, shots_of(parts), PARAMS)
    assert once(make, shots_of(parts), PARAMS.model_copy(update={"ridge": 0.4})) == 2
    assert once(make, shots_of(parts[:1]), PARAMS) == 3
    assert once(make, shots_of(parts[::-1]), PARAMS) == 4
    fewer = parts[0][3].model_copy(update={name: getattr(parts[0][3], name)[:5] for name in parts[0][3].array_specs()})
    assert once(make, shots_of([(*parts[0][:3], fewer), parts[1]]), PARAMS) == 5
    for i in range(3):  # another object, even if equal
        other = list(parts[0])
        other[i] = other[i].model_copy()
        assert once(make, shots_of([tuple(other), parts[1]]), PARAMS) == 6 + i  # type: ignore[list-item]
    assert once(make, shots_of(parts), PARAMS) == 1


def test_what_can_be_written_to_is_learned_from_each_time(make: Counted) -> None:
    parts = [box_cloud(0)]
    assert [once(make, shots_of(parts), PARAMS) for _ in range(2)] == [1, 2]


def test_shots_are_let_go_and_results_bounded(make: Counted, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remembering, "KEEP", 3)
    for seed in range(5):
        once(make, shots_of([stored(seed)]), PARAMS)
    gc.collect()
    alive = [ref() for of, _ in remembering._kept.values() for ref in of]
    assert len(remembering._kept) == 3 and alive == [None] * 9


def test_targets_find_the_same_as_with_shots_learned_anew() -> None:
    kept = [list(column) for column in zip(*(stored(i) for i in range(3)), strict=True)]
    for seed in (7, 8):
        fresh = [list(column) for column in zip(*(box_cloud(i) for i in range(3)), strict=True)]
        target = box_cloud(seed)[:3]
        one, other = (optimize(*target, *shots, OptimizeParams()) for shots in (kept, fresh))
        for name, array in one.present_arrays().items():
            np.testing.assert_array_equal(array, getattr(other, name))


def test_a_locked_artifact_cannot_be_written_to() -> None:
    read = box_cloud(0)[1]
    lazy = type(read).lazy(read.plain_fields(), set(read.present_arrays()), lambda name: getattr(read, name).copy())
    locked: list[Artifact] = [lazy.locked(), read.model_copy().locked()]
    for artifact in locked:
        for array in artifact.present_arrays().values():
            with pytest.raises(ValueError, match="read-only"):
                array[:] = 0
