"""SIFT keypoints of a surface: extrema over place and scale of differences of Gaussians.

The paper under comparison cites Rister et al. 2017, whose SIFT3D works on volumes (CT, MRI); on clouds the name
commonly means the Point Cloud Library's SIFTKeypoint, an analogue of Lowe 2004 with an intensity at each point, and
that is the variant here. The intensity is geometry's own: surface variation λ3 / (λ1 + λ2 + λ3) (Pauly et al. 2002).
Differences: no octave is thinned out (a few thousand points need none), and Gaussians are not cut off at 3 σ.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from b23d.stages.detectors.neighbourhoods import blocks, scatter_matrices

AROUND = 25
"""Nearest points (itself included) that an extremum is one among, at its own scale and both next to it (as PCL)."""


def sift3d(
    points: np.ndarray, min_scale: float, octaves: int, scales_per_octave: int, min_contrast: float
) -> npt.NDArray[np.float64]:
    """Strength (n,): the largest |difference of Gaussians| with which the point is an extremum; 0 where it is none.

    Standard deviations run from min_scale over `octaves` doublings, `scales_per_octave` steps each, and three more for
    the ends. The intensity is measured in balls of 2 min_scale. points: (n, 3) float64, lengths in the unit frame.
    """
    sigmas = min_scale * 2 ** (np.arange(octaves * scales_per_octave + 3) / scales_per_octave)
    strength = extrema(points, surface_variation(points, 2 * min_scale), sigmas).max(axis=0)
    return np.where(strength >= min_contrast, strength, 0)


def extrema(points: np.ndarray, intensity: np.ndarray, sigmas: np.ndarray) -> npt.NDArray[np.float64]:
    """|difference of Gaussians| where it is an extremum over place and scale, else 0: (len(sigmas) - 3, n).

    Level i is the intensity (n,) at sigmas[i + 2] less that at sigmas[i + 1]; the outermost differences are compared
    with only.
    """
    from scipy.spatial import cKDTree

    difference = np.diff(_blurred(points, intensity, sigmas), axis=0)  # (level, n)
    near = cKDTree(points).query(points, min(AROUND, len(points)))[1].reshape(len(points), -1)
    around = difference[:, near]
    highest, lowest = around.max(axis=2), around.min(axis=2)
    inner = difference[1:-1]
    top = inner >= np.maximum(np.maximum(highest[:-2], highest[1:-1]), highest[2:])
    bottom = inner <= np.minimum(np.minimum(lowest[:-2], lowest[1:-1]), lowest[2:])
    return np.where(top | bottom, np.abs(inner), 0)


def surface_variation(points: np.ndarray, radius: float) -> npt.NDArray[np.float64]:
    """λ3 / (λ1 + λ2 + λ3) of the balls' covariances, (n,) in 0 … 1/3: 0 on a plane."""
    about, mean = scatter_matrices(points, radius, np.ones(len(points)))
    values = np.linalg.eigvalsh(about - np.einsum("ni,nj->nij", mean, mean))
    return np.maximum(values[:, 0], 0) / np.maximum(values.sum(axis=1), np.finfo(np.float64).tiny)


def _blurred(points: np.ndarray, values: np.ndarray, sigmas: np.ndarray) -> npt.NDArray[np.float64]:
    """Gaussian means of `values` at all scales, (level, n). Single precision suffices for the weights, and is some five
    times faster."""
    columns = np.stack([np.ones_like(values), values], axis=1).astype(np.float32)
    smooth = np.empty((len(sigmas), len(points)))
    for rows, squared in blocks(points):
        squared = squared.astype(np.float32)
        for level, sigma in enumerate(sigmas):
            total, weighted = (np.exp(squared * np.float32(-0.5 / sigma**2)) @ columns).T
            smooth[level, rows] = weighted / total
    return smooth
