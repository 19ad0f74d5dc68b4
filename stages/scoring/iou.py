"""Label-agnostic, many-to-one counts: KeypointNet's and UKPGAN's IoU.

A prediction that is within the threshold of no annotated keypoint is a false positive, an annotated keypoint that is
within the threshold of no prediction a false negative, any other annotated keypoint a true positive. IoU = TP / (TP +
FP + FN), with sums over all shapes of a class. Names play no role, and one prediction may account for several annotated
keypoints.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

Inside = Literal["<=", "<"]


class Counts(NamedTuple):
    """Each (t,) int32."""

    true_positives: np.ndarray
    false_positives: np.ndarray
    false_negatives: np.ndarray


def within(distances: np.ndarray, thresholds: np.ndarray, inside: Inside) -> npt.NDArray[np.bool_]:
    """Which pairs count as met at which threshold: (k, g), (t,) → (t, k, g)."""
    limits = thresholds[:, None, None]
    return distances <= limits if inside == "<=" else distances < limits


def count(hits: np.ndarray) -> Counts:
    """Counts at every threshold; hits (t, k, g) as `within` gives them, for k predictions and g annotated keypoints."""
    found = hits.any(1).sum(1)
    return Counts(
        found.astype(np.int32),
        (~hits.any(2)).sum(1).astype(np.int32),
        (hits.shape[2] - found).astype(np.int32),
    )


def count_pairs(pairs: np.ndarray, predicted: int, annotated: int) -> Counts:
    """Counts where each prediction accounts for one keypoint at most; pairs (t,) sizes of the largest matchings."""
    return Counts(pairs.astype(np.int32), (predicted - pairs).astype(np.int32), (annotated - pairs).astype(np.int32))
