"""The door: for every candidate of one shape the candidate of the other."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from b23d.stages.correspondence.functional import eigenfunctions, refined
from b23d.stages.correspondence.landmarks import cost, guesses, landmarks
from b23d.stages.correspondence.sides import side_channels
from b23d.stages.correspondence.surfaces import FeaturedSurface, cosines

Method = Literal["nearest", "consistent", "smooth"]
SIDES = 0.2
"""Weight of a squared difference of side channels against one of cosines."""


def check_method(method: str) -> None:
    """Raise ValueError for a method that there is not."""
    if method not in get_args(Method):
        known = ", ".join(map(repr, get_args(Method)))
        raise ValueError(f"method: expected one of {known}, got {method!r}; choose one of them")


def correspond(first: FeaturedSurface, second: FeaturedSurface, method: Method) -> np.ndarray:
    """(n,) candidates of the second shape, for each of the first's.

    "nearest": of the most alike feature. "consistent": alike in feature and side, and as far from matched landmarks as
    here. "smooth": the best of these, each made a smooth map; that is for shapes of one kind, whose surfaces are alike
    as wholes. Raises ValueError for another method, and where a shape has fewer than eight different points, or all on
    a line.
    """
    check_method(method)
    alike = cosines(first.features, second.features)
    if method == "nearest":
        return np.asarray(alike.argmax(axis=1))
    own, theirs = side_channels(first, second)
    squares = (own**2).sum(axis=1)[:, None] + (theirs**2).sum(axis=1) - 2 * own @ theirs.T
    alike -= SIDES * squares
    here, there = first.reach(), second.reach()
    found = guesses(alike, here, there)
    if method == "consistent":
        return found[0][1]
    waves = _waves(first.name or "the first shape", first), _waves(second.name or "the second shape", second)
    smooth = [refined(guess, *waves) for _, guess in found]
    at = landmarks(here)
    return min(smooth, key=lambda matched: cost(matched, at, alike, here, there))


def _waves(name: str, shape: FeaturedSurface) -> np.ndarray:
    try:
        return eigenfunctions(shape.points)
    except ValueError as error:
        raise ValueError(f'{name}: {error}, or take method "consistent"') from error
