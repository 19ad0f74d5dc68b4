"""What correspondence needs to know of a shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class FeaturedSurface:
    """n candidates of one shape, in its unit frame."""

    points: np.ndarray
    """(n, 3)."""
    features: np.ndarray
    """(n, channel)."""
    distances: np.ndarray
    """(n, n) along the surface; +inf where no path joins two."""
    name: str = ""
    """For messages; "": the first, or the second."""

    def reach(self) -> np.ndarray:
        """(n, n) float32 distances; where no path joins two, the largest there is."""
        known = np.isfinite(self.distances)
        return np.where(known, self.distances, self.distances[known].max()).astype(np.float32)


def cosines(own: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """(n, m) float32 cosine of descriptors (n, channel) and (m, channel), each less its shape's mean."""
    found: np.ndarray = centred(own) @ centred(theirs).T
    return found


def centred(features: np.ndarray) -> np.ndarray:
    """(n, channel) float32 less their mean, of unit length."""
    return unit(features.astype(np.float32) - features.mean(axis=0, dtype=np.float32))


def unit(vectors: np.ndarray) -> np.ndarray:
    """(n, channel) of unit length; rows of zeros stay."""
    found: np.ndarray = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)
    return found
