"""Counts that know more than IoU's: one prediction for one keypoint, and the right name."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def matched(hits: np.ndarray) -> npt.NDArray[np.int32]:
    """Size of the largest one-to-one matching at every threshold, label-agnostic: (t, k, g) bool → (t,)."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import maximum_bipartite_matching

    if 0 in hits.shape[1:]:
        return np.zeros(len(hits), np.int32)
    sizes = [(maximum_bipartite_matching(csr_matrix(pairs), perm_type="column") >= 0).sum() for pairs in hits]
    return np.asarray(sizes, np.int32)


def labelled(hits: np.ndarray, predicted: np.ndarray, wanted: np.ndarray) -> npt.NDArray[np.int32]:
    """How many annotated keypoints the prediction of the wanted name meets, at every threshold.

    hits: (t, k, g) bool. predicted: (k,) ids of the predictions. wanted: (g,) id that is looked for at each annotated
    keypoint: its own, or the one that a symmetry puts there. Ids below 0 are no names. Returns (t,).
    """
    named = (predicted[:, None] == wanted[None]) & (wanted >= 0)[None]  # (k, g)
    return (hits & named).any(1).sum(1).astype(np.int32)


def symmetric(hits: np.ndarray, predicted: np.ndarray, exchanges: np.ndarray) -> npt.NDArray[np.int32]:
    """As `labelled`, after the exchange of names that meets most keypoints: one exchange for the shape and all
    thresholds.

    exchanges: (e, g) wanted ids of each exchange; the first one, identity, wins ties.
    """
    counts = np.stack([labelled(hits, predicted, wanted) for wanted in exchanges])  # (e, t)
    return counts[counts.sum(1).argmax()]
