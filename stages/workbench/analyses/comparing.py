"""How alike descriptors are: arrays in, numbers out."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

PAIRS = 20_000
"""Random pairs of points that a typical difference is taken over."""
Floats = npt.NDArray[np.float64]


def cosine(a: np.ndarray, b: np.ndarray) -> Floats:
    """(n,) cosine similarity of the rows of a and b, (n, channel) each; 1 between two rows of zeros, 0 between one and
    another."""
    a, b = a.astype(np.float64), b.astype(np.float64)
    sizes = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    equal = (a == b).all(axis=1).astype(np.float64)
    found: Floats = np.divide((a * b).sum(axis=1), sizes, out=equal, where=sizes > 0)
    return found


def centred(features: np.ndarray, of: np.ndarray) -> Floats:
    """(n, channel) less the mean of the rows `of` (m, channel)."""
    found: Floats = features.astype(np.float64) - of.mean(axis=0, dtype=np.float64)
    return found


def typical_difference(features: np.ndarray, seed: int = 0) -> float:
    """Median Euclidean distance between two different random rows of (n, channel), n > 1: how far apart a shape's
    descriptors are."""
    rng, count = np.random.default_rng(seed), len(features)
    first = rng.integers(0, count, PAIRS)
    second = (first + rng.integers(1, count, PAIRS)) % count
    values = features.astype(np.float64)
    return float(np.median(np.linalg.norm(values[first] - values[second], axis=1)))


def nearer_share(right: np.ndarray, others: np.ndarray) -> Floats:
    """(k,) the share of `others` (k, m) that is less than `right` (k,); ties count half. NaN entries of `others` do not
    count.

    One minus this is the area under the ROC curve of each row: the chance that a random other is larger. NaN where a
    row has none.
    """
    there = ~np.isnan(others)
    less = np.where(there, (others < right[:, None]) + 0.5 * (others == right[:, None]), 0.0).sum(axis=1)
    count = there.sum(axis=1)
    found: Floats = np.divide(less, count, out=np.full(len(right), np.nan), where=count > 0)
    return found
