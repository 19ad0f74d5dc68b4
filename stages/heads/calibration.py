"""When is a keypoint there? Judged on shots that the detector has not seen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from b23d.stages.heads.detector import probabilities
from b23d.stages.heads.inputs import Example
from b23d.stages.heads.training import Options, train


def held_out_peaks(examples: Sequence[Example], ids: np.ndarray, options: Options) -> npt.NDArray[np.float32]:
    """Largest probability of each id on each shot by a detector trained on the others, (shot, k); NaN where those lack
    the id."""
    peaks = np.full((len(examples), len(ids)), np.nan, np.float32)
    for i, one in enumerate(examples):
        others = [*examples[:i], *examples[i + 1 :]]
        if any(len(other.ids) for other in others):
            detector = train(others, options)
            peaks[i, np.searchsorted(ids, detector.ids)] = probabilities(detector, one.inputs).max(0)
    return peaks


def threshold(peaks: np.ndarray, has: np.ndarray) -> float:
    """The probability that best separates ids that a shot has from those that it lacks; all ids and shots together.

    peaks: (shot, k), NaN where not known. has: (shot, k) bool. Best: most right judgements, and of equally good
    thresholds the lowest, since a keypoint missed costs as much as one too many, and few are absent. Halfway between
    the two peaks it parts; 0 (everything is present) where nothing is gained by parting.
    """
    known = np.isfinite(peaks)
    values, present = peaks[known].astype(np.float64), has[known]
    order = np.argsort(values, kind="stable")
    values, present = values[order], present[order]
    # right[i]: judgements that are right when the i lowest peaks are judged absent
    right = np.concatenate([[0], np.cumsum(~present)]) + present.sum() - np.concatenate([[0], np.cumsum(present)])
    parts = np.concatenate([[True], np.diff(values) > 0, [False]]) if len(values) else np.ones(1, bool)
    best = int(np.argmax(np.where(parts, right, -1)))
    return 0.0 if best == 0 else float((values[best - 1] + values[best]) / 2)
