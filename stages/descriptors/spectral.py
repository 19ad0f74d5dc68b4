"""Heat and wave kernel signatures from the Laplace–Beltrami spectrum of a mesh or a cloud.

Everything is scaled to unit surface area, so that neither depends on the shape's size, and divided by its integral, so
that the mean over the surface is 1 in every channel.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from robust_laplacian import mesh_laplacian, point_cloud_laplacian
from scipy.linalg import eigh
from scipy.sparse import csc_matrix, diags
from scipy.sparse.linalg import eigsh

from b23d.stages.geodesics.connectivity import weld
from b23d.stages.geodesics.insertion import insert_points

SHIFT = -0.01
"""Spectral shift: below the spectrum, whose first non-zero value is 8 π on the unit-area sphere, so that L - SHIFT M is
definite."""
NEIGHBORS = 30
"""Size of a cloud's local triangulations (Sharp and Crane 2020)."""
DENSE = 400
"""Below this many places all eigenpairs are computed."""


class Spectrum(NamedTuple):
    values: np.ndarray
    """(k,) float64 eigenvalues of the unit-area surface, ascending from 0."""
    functions: np.ndarray
    """(n, k) float64 eigenfunctions at the points; the square of each has mean 1 over the surface."""


def mesh_spectrum(
    vertices: np.ndarray, faces: np.ndarray, point_faces: np.ndarray, barycentrics: np.ndarray, eigenpairs: int
) -> Spectrum:
    """The lowest part of a mesh's spectrum at points on it: (v, 3), (f, 3), (n,), (n, 3).

    The points are inserted as vertices, so coarse meshes resolve as much as the points do. The Laplacian is that of the
    tufted cover's intrinsic Delaunay triangulation: any mesh will do, but unconnected parts do not exchange heat.
    """
    inserted, split, at = insert_points(*weld(vertices, faces), point_faces, barycentrics)
    used, compact = np.unique(split, return_inverse=True)
    stiffness, mass = mesh_laplacian(inserted[used], compact.reshape(split.shape))
    return _spectrum(stiffness, mass, np.searchsorted(used, at), eigenpairs)


def cloud_spectrum(points: np.ndarray, eigenpairs: int) -> Spectrum:
    """The lowest part of the spectrum of the surface that points (n, 3) sample; coincident points count once.

    Raises ValueError where there are fewer than eight places, or they are on a line.
    """
    places, at = np.unique(points.astype(np.float64), axis=0, return_inverse=True)
    if len(places) < 8:
        raise ValueError(
            f"cloud: expected at least 8 different points for a Laplacian, got {len(places)}; use more candidates"
        )
    if np.linalg.matrix_rank(places - places.mean(axis=0), tol=1e-6 * np.ptp(places)) < 2:
        raise ValueError(
            "cloud: expected points of a surface for a Laplacian, got all on a line; give a surface's points"
        )
    stiffness, mass = point_cloud_laplacian(places, n_neighbors=min(NEIGHBORS, len(places) - 1))
    return _spectrum(stiffness, mass, at.ravel(), eigenpairs)


def heat_kernel_signature(spectrum: Spectrum, times: np.ndarray) -> np.ndarray:
    """(n, t) float64: Σ exp(-λ t) φ² / Σ exp(-λ t) (Sun, Ovsjanikov, Guibas 2009, section 4.1's scaled signature).

    times (t,): diffusion times for unit area.
    """
    return _mixed(spectrum, -spectrum.values * times[:, None])


def wave_kernel_signature(spectrum: Spectrum, energies: int, width: float) -> np.ndarray:
    """(n, e) float64: Σ exp(-(e - log λ)² / 2σ²) φ² over the same sum of weights (Aubry, Schlickewei, Cremers 2011, Eq.
    11).

    `energies` steps of log λ, `width` = σ in steps; the range is the spectrum's own, 2σ inside its ends. Constant
    functions (λ = 0, one a component) are left out.

    Raises ValueError where no other eigenvalue is known.
    """
    waves = spectrum.values > 1e-6 * spectrum.values[-1]
    if waves.sum() < 2:
        raise ValueError(
            f"spectrum: expected eigenvalues above zero, got {spectrum.values[-3:]}; "
            "raise eigenpairs, or describe the cloud"
        )
    logs = np.log(spectrum.values[waves])
    # 2 sigma at both ends: low + 2 w step … high - 2 w step in `energies` steps
    step = (logs[-1] - logs[0]) / (energies - 1 + 4 * width)
    at = logs[0] + step * (2 * width + np.arange(energies))
    exponents = -((at[:, None] - logs) ** 2) / (2 * (width * step) ** 2)
    return _mixed(Spectrum(spectrum.values[waves], spectrum.functions[:, waves]), exponents)


def _mixed(spectrum: Spectrum, exponents: np.ndarray) -> np.ndarray:
    weights = np.exp(exponents - exponents.max(axis=1, keepdims=True))  # (t, k)
    return spectrum.functions**2 @ (weights / weights.sum(axis=1, keepdims=True)).T


def _spectrum(stiffness: csc_matrix, mass: csc_matrix, at: np.ndarray, eigenpairs: int) -> Spectrum:
    areas = mass.diagonal()
    areas = np.maximum(areas / areas.sum(), 1e-12)  # a vertex of faces without area
    count = len(areas)
    if count <= DENSE:
        values, functions = eigh(stiffness.toarray(), np.diag(areas), subset_by_index=(0, min(eigenpairs, count) - 1))
    else:
        start = np.random.default_rng(0).standard_normal(count)  # ARPACK's own would differ from run to run
        values, functions = eigsh(
            stiffness.tocsc(), min(eigenpairs, count // 2), diags(areas).tocsc(), sigma=SHIFT, v0=start
        )
    order = values.argsort()
    return Spectrum(np.maximum(values[order], 0), functions[at][:, order])
