"""Spectral refinement: a map between surfaces made smooth, coarse waves first (ZoomOut; Melzi et al. 2019).

Hand-written: it is ten lines here, and pyFM wants meshes, where candidates may be a cloud's.
"""

from __future__ import annotations

import numpy as np

FIRST, LAST, STEP = 20, 100, 8
"""Eigenfunctions used, from the first round to the last."""


def eigenfunctions(points: np.ndarray) -> np.ndarray:
    """(n, LAST) of the Laplacian of the surface that points (n, 3) sample, ascending; fewer where there are few points.

    Raises ValueError where there are fewer than eight places, or they are on a line.
    """
    from b23d.stages.descriptors.spectral import cloud_spectrum

    return cloud_spectrum(points, LAST).functions


def refined(matched: np.ndarray, own: np.ndarray, theirs: np.ndarray) -> np.ndarray:
    """(n,) points of the other shape, from a first guess (n,); own (n, k) and theirs (m, k) eigenfunctions.

    Each round carries the other's first functions over by the guess, writes them in one's own, and takes for each point
    the other's whose functions are then nearest.
    """
    most = min(own.shape[1], theirs.shape[1])
    for count in range(min(FIRST, most), most + 1, STEP):
        carried = np.linalg.lstsq(own[:, :count], theirs[matched, :count], rcond=None)[0]  # (count, count)
        wanted = theirs[:, :count] @ carried.T
        matched = _nearest(own[:, :count], wanted)
    return matched


def _nearest(own: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(n,) rows of wanted (m, k) nearest to rows of own (n, k): largest product less half the square, in one product of
    float32, for that is where the time goes."""
    ones = np.ones((len(own), 1), np.float32)
    left = np.concatenate([own.astype(np.float32), ones], axis=1)
    right = np.concatenate([wanted, -0.5 * (wanted**2).sum(axis=1, keepdims=True)], axis=1).astype(np.float32)
    found: np.ndarray = (left @ right.T).argmax(axis=1)
    return found
