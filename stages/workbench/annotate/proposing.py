"""Which shape to annotate next: the one that the most shapes without keypoints are like, and none with keypoints is."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

AHEAD = 12
"""Proposals in a row; after a few annotations they are made anew anyway."""


def proposed(alike: np.ndarray, annotated: Collection[int], may: Collection[int], ahead: int = AHEAD) -> list[int]:
    """The order in which to annotate, at most `ahead` of `may`: each is the one that raises most how like its most
    alike annotated shape every shape is (facility location, Nemhauser et al., 1978, greedy).

    alike: (n, n) symmetric, of any scale; ties go to the first.

    Measured on KeypointNet's bathtubs and beds by how near the weighted mean of the shots' places is to the keypoints
    of the rest (not by whole runs): bathtubs gain for 2 … 25 shots whatever the first one is (.45 against .44 at 10,
    about half the spread); beds gain little but by the first one. Shapes farthest from all annotated ones, outliers for
    the most part, are worse than random up to 10 shots on bathtubs.
    """
    found: list[int] = []
    left = np.array(sorted(set(may) - set(annotated)), np.int64)
    best = alike[:, list(annotated)].max(1) if len(annotated) else np.full(len(alike), alike.min(initial=0.0))
    while len(left) and len(found) < ahead:
        gains = np.maximum(alike[:, left] - best[:, None], 0).sum(0)
        chosen = int(left[int(gains.argmax())])
        found.append(chosen)
        left, best = left[left != chosen], np.maximum(best, alike[:, chosen])
    return found
