"""Many shots: what they teach is summed up from as much as is needed of them, whatever order they or their candidates
come in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from b23d.stages.solvers.learn_options import LearnParams
from b23d.stages.solvers.posterior import learning
from b23d.stages.solvers.posterior.a_few import a_few
from b23d.stages.solvers.posterior.geometry import Prepared, descriptors
from b23d.stages.solvers.posterior.turning import REFERENCES, aligned
from tests.test_posterior import prepared

PARAMS = LearnParams(components=8)


@given(st.integers(1, 500), st.integers(1, 50))
def test_a_few_are_spread_evenly_over_all(count: int, most: int) -> None:
    few = a_few(count, most)
    assert len(few) == min(count, most) and few[0] == 0
    if len(few) > 1:
        assert few[-1] == count - 1
        assert np.ptp(np.diff(few)) <= 1


def shuffled(shape: Prepared, seed: int) -> Prepared:
    order = np.random.default_rng(seed).permutation(len(shape.position))
    new = {name: getattr(shape, name)[order] for name in ("position", "box", "features", "geometry", "shift")}
    return replace(shape, **new)


def test_a_part_of_the_points_tells_what_all_do(monkeypatch: pytest.MonkeyPatch) -> None:
    shots = [prepared(i) for i in range(12)]
    whole = learning.basis_of(shots, PARAMS)
    monkeypatch.setattr(learning, "SEEN", sum(len(shot.position) for shot in shots) // 3)
    part = learning.basis_of(shots, PARAMS)
    assert not np.array_equal(part.mean, whole.mean)
    assert np.abs(part.mean - whole.mean).max() < 0.2 * whole.scale.max()
    np.testing.assert_allclose(part.scale, whole.scale, rtol=0.2)
    overlap = np.linalg.svd(part.basis[:, :3].T @ whole.basis[:, :3], compute_uv=False)
    assert overlap.min() > 0.98  # the same three principal directions, as a space


def test_what_is_summed_up_does_not_depend_on_the_order_of_candidates(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(learning, "SEEN", 1000)
    shots = [prepared(i) for i in range(6)]
    one, other = (learning.basis_of(some, PARAMS) for some in (shots, [shuffled(shot, 1) for shot in shots]))
    for name in ("basis", "mean", "scale", "covariance"):
        np.testing.assert_allclose(getattr(other, name), getattr(one, name), atol=1e-4)


def test_descriptors_of_some_points_are_those_of_all() -> None:
    shape, basis = prepared(0), np.eye(32, 4, dtype=np.float32)
    some = np.array([5, 3, 300])
    np.testing.assert_allclose(descriptors(shape, basis, some), descriptors(shape, basis)[some], rtol=1e-6)


@pytest.mark.parametrize("odd", [0, 1, 11, 19])
def test_of_many_shots_the_odd_one_is_turned_too(odd: int) -> None:
    shots = [prepared(i, turn=1.0 if i == odd else 0.0) for i in range(20)]
    assert len(shots) > 2 * REFERENCES
    turns = aligned(shots, PARAMS.same_frame)[1]
    assert turns[odd] == pytest.approx(-1.0, abs=0.1)
    assert not np.delete(turns, odd).any()
