"""Whether confidence means what it says: of the keypoints that are said to be right with probability p, a share p is.

Niculescu-Mizil and Caruana, Predicting good probabilities with supervised learning, ICML 2005; the expected calibration
error of Naeini et al., AAAI 2015.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

BINS = 10


@dataclass(frozen=True)
class Reliability:
    """b bins of equal width over 0 … 1, those that something falls into."""

    counts: npt.NDArray[np.int64]
    """(b,)"""
    said: npt.NDArray[np.float64]
    """(b,) mean confidence."""
    true: npt.NDArray[np.float64]
    """(b,) share that was right."""

    @property
    def error(self) -> float:
        """Expected calibration error, 0 … 1: mean over all of what parts `said` from `true` in their bin."""
        return float((self.counts * np.abs(self.said - self.true)).sum() / self.counts.sum())


def reliability(confidence: np.ndarray, right: np.ndarray) -> Reliability | None:
    """Of numbers (n,) in 0 … 1 and whether each was right, (n,) bool; None of nothing."""
    if not len(confidence):
        return None
    sure = np.asarray(confidence, np.float64)
    bins = np.clip((sure * BINS).astype(int), 0, BINS - 1)
    counts = np.bincount(bins, minlength=BINS)
    kept = counts > 0
    said, true = (np.bincount(bins, values, BINS)[kept] / counts[kept] for values in (sure, np.asarray(right, float)))
    return Reliability(counts[kept], said, true)
