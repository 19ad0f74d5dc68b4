"""What discriminants are taken against: how all points differ, then how keypoints differ from shot to shot."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from b23d.stages.solvers.posterior.learning import WORTH, discriminating_covariance

CHANNELS = 6


def everywhere(rng: np.random.Generator) -> np.ndarray:
    points = rng.normal(size=(50, CHANNELS))
    return points.T @ points / 50


@given(seed=st.integers(0, 999), shots=st.integers(2, 5), ids=st.integers(1, 4))
@settings(max_examples=25, deadline=None)
def test_it_is_a_covariance_as_large_as_that_of_all_points(seed: int, shots: int, ids: int) -> None:
    rng = np.random.default_rng(seed)
    has, examples = rng.random((shots, ids)) < 0.7, rng.normal(size=(shots, ids, CHANNELS))
    wide = everywhere(rng)
    found = discriminating_covariance(wide, examples * has[..., None], has)
    np.testing.assert_allclose(np.trace(found), np.trace(wide))
    np.testing.assert_allclose(found, found.T, atol=1e-12)
    assert np.linalg.eigvalsh(found).min() > -1e-12


@pytest.mark.parametrize("shots", [1, 2, 3])
def test_one_shot_and_its_copies_leave_that_of_all_points(shots: int) -> None:
    rng = np.random.default_rng(0)
    examples, wide = np.repeat(rng.normal(size=(1, 4, CHANNELS)), shots, 0).astype(np.float32), everywhere(rng)
    np.testing.assert_array_equal(discriminating_covariance(wide, examples, np.ones((shots, 4), bool)), wide)


def test_an_id_of_one_shot_alone_says_nothing_of_how_ids_differ() -> None:
    rng = np.random.default_rng(0)
    examples, has, wide = rng.normal(size=(3, 4, CHANNELS)), np.ones((3, 4), bool), everywhere(rng)
    has[1:, 3] = False
    kept = discriminating_covariance(wide, examples[:, :3], has[:, :3])
    np.testing.assert_allclose(discriminating_covariance(wide, examples * has[..., None], has), kept)


def test_so_many_further_examples_as_they_are_worth_are_half_of_it() -> None:
    """Two ids whose examples differ in the first channel alone, by one either way."""
    count = int(WORTH) // 2 + 1
    examples = np.zeros((count, 2, CHANNELS))
    examples[:, :, 0] = np.where(np.arange(count) % 2, 1, -1)[:, None]
    found = discriminating_covariance(np.eye(CHANNELS), examples, np.ones((count, 2), bool))
    expected = np.eye(CHANNELS) / 2
    expected[0, 0] += CHANNELS / 2
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_what_differs_from_shot_to_shot_counts_less_the_more_shots_show_it() -> None:
    rng = np.random.default_rng(0)
    examples = 0.1 * rng.normal(size=(12, 3, CHANNELS)) + np.arange(3)[:, None]
    examples[..., 0] += 3 * rng.normal(size=(12, 3))
    said = [
        discriminating_covariance(np.eye(CHANNELS), examples[:shots], np.ones((shots, 3), bool)) for shots in (2, 6, 12)
    ]
    weights = [np.linalg.solve(one + 0.3 * np.eye(CHANNELS), np.ones(CHANNELS)) for one in said]
    shares = [abs(weight[0]) / np.abs(weight).sum() for weight in weights]
    assert shares[0] > shares[1] > shares[2]
