"""Farthest-point sampling along the surface (Eldar et al. 1997), the paper's baseline."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt


def farthest(distances: np.ndarray, count: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """The candidates that lie farthest apart, and each one's distance from those before it.

    distances: (n, n), geodesic; what no path joins (inf) counts as the largest distance there is. The first point is
    the one with the largest mean distance from all, as in the paper; its own "distance from those before" is that mean.
    Of equal ones, the first in the cloud's order. Returns (k,) indices and (k,) distances, k = min(count, n).
    """
    finite = np.isfinite(distances)
    if not finite.all():
        distances = np.where(finite, distances, distances[finite].max(initial=0))
    means = distances.mean(axis=1, dtype=np.float64)
    chosen, gaps = [int(means.argmax())], [float(means.max())]
    nearest = distances[chosen[0]].astype(np.float64)
    nearest[chosen[0]] = -1  # never again, even where all others coincide with what is chosen
    for _ in range(min(count, len(distances)) - 1):
        chosen.append(int(nearest.argmax()))
        gaps.append(float(nearest.max()))
        np.minimum(nearest, distances[chosen[-1]], out=nearest)
        nearest[chosen[-1]] = -1
    return np.array(chosen[:count], np.int64), np.array(gaps[:count])
