"""SHOT: signatures of histograms of orientations (Salti, Tombari, Di Stefano 2014), our own implementation.

Each point has a repeatable frame from its neighbourhood; the ball around it is cut into 8 azimuths × 2 elevations ×
2 shells, each holding a histogram of 11 bins over the cosine between the neighbours' normals and the frame's z axis.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.spatial import cKDTree

AZIMUTHS, ELEVATIONS, SHELLS, COSINES = 8, 2, 2, 11
CHANNELS = AZIMUTHS * ELEVATIONS * SHELLS * COSINES
FEWEST = 5
"""Neighbours below which a point has no frame."""
FLAT = 1e-5
"""Offsets along an axis smaller than this share of the radius are rounding, on neither side."""


def shot(points: np.ndarray, radius: float, normals: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """SHOT descriptors of all points of a cloud, with the cloud itself as support.

    Args:
        points: (n, 3) float.
        radius: of the support, in the points' unit.
        normals: (n, 3) of unit length and consistent side; without, the z axes of the points' own frames.

    Returns:
        descriptors (n, 352) float64 of unit length, and defined (n,) bool: False (and zeros) with fewer than 5
        neighbours.
    """
    points = np.asarray(points, dtype=np.float64)
    centers, others, distances = _pairs(points, radius)
    offsets = points[others] - points[centers]
    outward = points - points.mean(axis=0) if normals is None else normals
    frames = local_frames(centers, offsets, distances, radius, outward)
    normals = frames[:, 2] if normals is None else normals
    local = np.einsum("pax,px->pa", frames[centers], offsets)  # (p, 3): along x, y, z of the centre's frame
    cosines = np.einsum("px,px->p", frames[centers, 2], normals[others]).clip(-1, 1)

    azimuth = (np.arctan2(local[:, 1], local[:, 0]) / (2 * np.pi) % 1.0) * AZIMUTHS
    elevation = np.arccos((local[:, 2] / distances).clip(-1, 1)) / np.pi * ELEVATIONS
    sizes = (AZIMUTHS, ELEVATIONS, SHELLS, COSINES)
    shares = [
        _between(azimuth, AZIMUTHS, wraps=True),
        _between(elevation, ELEVATIONS),
        _between(distances / radius * SHELLS, SHELLS),
        _between((1 + cosines) / 2 * COSINES, COSINES),
    ]
    flat = np.zeros(len(points) * CHANNELS)
    for corner in product((0, 1), repeat=4):  # quadrilinear: every neighbour counts in 16 cells
        cell, weight = centers, np.ones(len(centers))
        for side, (bins, weights), size in zip(corner, shares, sizes, strict=True):
            cell, weight = cell * size + bins[side], weight * weights[side]
        flat += np.bincount(cell, weight, len(flat))
    histograms = flat.reshape(len(points), CHANNELS)
    defined = np.bincount(centers, minlength=len(points)) >= FEWEST
    lengths = np.linalg.norm(histograms, axis=1, keepdims=True)
    return np.divide(
        histograms, lengths, out=np.zeros_like(histograms), where=(lengths > 0) & defined[:, None]
    ), defined


def local_frames(
    centers: np.ndarray, offsets: np.ndarray, distances: np.ndarray, radius: float, outward: np.ndarray
) -> np.ndarray:
    """Repeatable local reference frames (n, 3, 3) float64, rows x, y, z, right-handed (Salti et al. 2014, section 3).

    Axes are those of the covariance weighted by (radius - distance), largest to smallest; x and z point to where more
    neighbours are, or where these are farther out if they are as many. On a plane neither tells the sides of z: there
    it goes along `outward` (n, 3). Neighbour p of point centers[p] is at offsets[p] (p, 3), distances[p] (p,) from it.
    """
    count = len(outward)
    products = (radius - distances)[:, None] * (offsets[:, :, None] * offsets[:, None]).reshape(-1, 9)
    covariances = np.stack([np.bincount(centers, products[:, i], count) for i in range(9)], axis=1).reshape(-1, 3, 3)
    axes = np.linalg.eigh(covariances)[1].transpose(0, 2, 1)[:, ::-1]  # rows, largest first
    x, z = axes[:, 0], axes[:, 2]
    x = x * _side(centers, np.einsum("px,px->p", x[centers], offsets), radius, np.ones(count))[:, None]
    z = z * _side(centers, np.einsum("px,px->p", z[centers], offsets), radius, (z * outward).sum(axis=1))[:, None]
    return np.stack([x, np.cross(z, x), z], axis=1)


def _side(centers: np.ndarray, along: np.ndarray, radius: float, otherwise: np.ndarray) -> np.ndarray:
    """(n,) 1 or -1: the side of each point with more neighbours, by their offsets (p,) along its axis; else sign of
    `otherwise`."""
    along = np.where(np.abs(along) > FLAT * radius, along, 0)
    more = np.bincount(centers, np.sign(along), len(otherwise))
    farther = np.bincount(centers, along, len(otherwise))
    decisive = np.where(more != 0, more, np.where(np.abs(farther) > FLAT * radius, farther, otherwise))
    return np.where(decisive < 0, -1.0, 1.0)


def _pairs(points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every point with every other place within the radius: centres (p,), others (p,), distances (p,) > 0."""
    pairs = cKDTree(points).query_pairs(radius, output_type="ndarray")
    centers, others = np.concatenate([pairs, pairs[:, ::-1]]).T
    distances = np.linalg.norm(points[others] - points[centers], axis=1)
    apart = distances > 0
    return centers[apart], others[apart], distances[apart]


def _between(at: np.ndarray, size: int, wraps: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """The two bins (2, p) whose centres enclose `at` (p,), in bins, and their linear shares (2, p) of it.

    Beyond the outer centres the outer bin has all, unless the bins wrap round.
    """
    lower = np.floor(at - 0.5).astype(np.int64)
    share = at - 0.5 - lower
    bins = np.stack([lower, lower + 1])
    return bins % size if wraps else bins.clip(0, size - 1), np.stack([1 - share, share])
