"""From probabilities to one candidate an id."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def choose(likely: np.ndarray, lengths: np.ndarray, separation: float) -> npt.NDArray[np.int64]:
    """The candidate of each id, (k,): its most probable one, the first of equals.

    likely: (n, k). lengths: (n, n). separation > 0: ids choose in the order of their largest probability, and a
    candidate within `separation` of a chosen one is taken; an id that finds all taken keeps its most probable one.
    """
    best = likely.argmax(0)
    if separation == 0:
        return best
    free = np.ones(len(likely), bool)
    for i in np.argsort(-likely.max(0), kind="stable"):
        if free.any():
            best[i] = np.where(free, likely[:, i], -1).argmax()
        free &= lengths[best[i]] > separation
    return best
