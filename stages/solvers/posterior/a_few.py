"""A few of many, so that what they cost does not grow with the shots."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def a_few(count: int, most: int) -> npt.NDArray[np.int64]:
    """(m,) of the first `count` integers, ascending and evenly spread: all of them, or `most`."""
    return np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(np.int64))
