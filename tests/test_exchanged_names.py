"""Scores after an exchange of names: one that a symmetry permits, or front and back."""

from __future__ import annotations

import numpy as np

from b23d.schemas.up_axis import UP_AXES
from b23d.stages.score import ScoreParams, score
from tests.test_score import annotated, line_shape, predicted, scored


def test_exchanged_sides_count_as_symmetric() -> None:
    pairs: list[tuple[int, ...]] = [(0, 1), (2, 3)]
    truth = annotated([0, 1, 2, 3], [0, 100, 20, 80], reflections=pairs)
    swapped = scored(predicted([0, 1, 2, 3], [100, 0, 80, 20]), truth)
    assert (swapped.labelled == 0).all()
    assert (swapped.symmetric == 4).all()
    half = scored(predicted([0, 1, 2, 3], [100, 0, 20, 80]), truth)  # one pair only is no symmetry of the shape
    assert (half.symmetric == 2).all()
    right = scored(predicted([0, 1, 2, 3], [0, 100, 20, 80]), truth)
    assert np.array_equal(right.symmetric, right.labelled)


def test_the_opposite_front_counts_as_either_front_without_any_symmetry_annotated() -> None:
    truth = annotated([0, 1, 2, 3], [0, 100, 20, 80])
    opposite = scored(predicted([0, 1, 2, 3], [100, 0, 80, 20]), truth)
    assert (opposite.labelled == 0).all() and (opposite.symmetric == 0).all()
    assert (opposite.either_front == 4).all()
    half = scored(predicted([0, 1, 2, 3], [100, 0, 20, 80]), truth)  # one end only is exchanged: neither front
    assert (half.either_front == 2).all()
    right = scored(predicted([0, 1, 2, 3], [0, 100, 20, 80]), truth)
    assert np.array_equal(right.either_front, right.labelled)


def test_either_front_is_never_below_the_labelled_count() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        count = int(rng.integers(1, 9))
        truth = annotated(list(range(count)), rng.permutation(100)[:count].tolist())
        guessed = scored(predicted(rng.permutation(count).tolist(), rng.permutation(100)[:count].tolist()), truth)
        assert guessed.either_front.sum() >= guessed.labelled.sum()


def test_symmetries_turn_about_the_axis_that_points_up_in_the_file() -> None:
    truth = annotated([0, 1, 2, 3], [0, 100, 20, 80], rotations=[(0, 1), (2, 3)])
    for up in UP_AXES:
        given = line_shape().model_copy(update={"up": up})
        lying = truth.model_copy(update={"positions": truth.positions @ given.rotation})
        found = score(given, predicted([0, 1, 2, 3], [100, 0, 80, 20]), lying, [], ScoreParams())
        assert (found.symmetric == 4).all() and (found.either_front == 4).all(), up
