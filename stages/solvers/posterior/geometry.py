"""A shape in its own box, and what its points look like to their neighbourhood. All of it invariant to turns about the
up axis, but for the mean-shift vectors and the places, which are what a common frame is for."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from b23d.stages.solvers.scaling import Relative

PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
THINNEST = 0.05  # a side thinner than this share of the largest is not stretched to a box's full side
ROWS = 64  # neighbourhoods summed at once, so that a processor's cache holds them
NOTHING = np.float32(-60)  # exponents below count as this: e^-60 is no part of a sum, but denormal numbers are slow


@dataclass(frozen=True)
class Prepared:
    """One shape, ready to learn from or to predict on. n candidates, r radii."""

    position: np.ndarray
    """(n, 3) float32, centred, largest box side 1."""
    sides: np.ndarray
    """(3,) of that box."""
    box: np.ndarray
    """(n, 3) position over sides, in [-.5, .5]."""
    features: np.ndarray
    """(n, channel) float32, centred, of unit length."""
    geometry: np.ndarray
    """(n, 6 r + 1) local geometry and eccentricity."""
    shift: np.ndarray
    """(n, 3 r) mean-shift vectors."""
    distances: np.ndarray
    """(n, n) float32 geodesic distances over the shape's largest; (0, n) where nothing is searched for on it."""
    diameter: float
    """That largest distance, in largest box sides."""
    ids: np.ndarray
    keypoints: np.ndarray
    """(g,) candidates of the keypoints `ids`; empty on a target."""


def prepare(
    points: np.ndarray,
    features: np.ndarray,
    distances: Relative,
    radii: tuple[float, ...],
    ids: np.ndarray | None = None,
    keypoints: np.ndarray | None = None,
) -> Prepared:
    """points (n, 3) in the unit frame, features (n, channel) centred and of unit length."""
    position, sides, scale = in_box(points)
    shift, local = local_geometry(position, radii)
    eccentricity = distances.relative.mean(1)
    geometry = np.concatenate([local, (eccentricity / max(float(eccentricity.mean()), 1e-12))[:, None]], 1).astype(
        np.float32
    )
    none = np.zeros(0, int)
    return Prepared(
        position,
        sides,
        position / np.maximum(sides, THINNEST),
        features,
        geometry,
        shift,
        distances.relative,
        distances.largest / scale,
        none if ids is None else ids,
        none if keypoints is None else keypoints,
    )


def in_box(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Points (n, 3) float32 of their box, centred and of longest side 1; its sides (3,); and what was its longest."""
    low, high = points.min(0), points.max(0)
    scale = float((high - low).max()) or 1.0
    position = ((points - (low + high) / 2) / scale).astype(np.float32)
    return position, ((high - low) / scale).astype(np.float32), scale


def local_geometry(position: np.ndarray, radii: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Mean-shift vectors (n, 3 r) and (n, 6 r) of: their length, their height, the neighbourhood's three standard
    deviations, its log mass. Gaussian neighbourhoods of standard deviation radius / 1.5."""
    products = np.stack([position[:, a] * position[:, b] for a, b in PAIRS], 1)
    moments = np.concatenate([np.ones_like(position[:, :1]), position, products], 1)
    transposed = np.ascontiguousarray(moments.T)
    sums = np.zeros((len(radii), *moments.shape), moments.dtype)
    for start in range(0, len(position), ROWS):
        rows, later = slice(start, start + ROWS), slice(start + ROWS, None)
        square = squared(position[rows], position[start:])
        exponents = np.empty_like(square)
        for among, radius in zip(sums, radii, strict=True):
            np.multiply(square, np.float32(-1 / (2 * (radius / 1.5) ** 2)), out=exponents)
            np.maximum(exponents, NOTHING, out=exponents)
            weights = np.exp(exponents, out=exponents)
            among[rows] += weights @ moments[start:]
            among[later] += (transposed[:, rows] @ weights[:, ROWS:]).T  # as far from each other either way
    shifts, descriptors = [], []
    for among, radius in zip(sums, radii, strict=True):
        mass = among[:, :1]
        mean, second = among[:, 1:4] / mass, among[:, 4:] / mass
        covariance = np.empty((len(position), 3, 3), position.dtype)
        for j, (a, b) in enumerate(PAIRS):
            covariance[:, a, b] = covariance[:, b, a] = second[:, j] - mean[:, a] * mean[:, b]
        shift = (mean - position) / radius
        spread = np.sqrt(np.maximum(np.linalg.eigvalsh(covariance), 0)) / radius
        crowd = np.log(mass)
        shifts.append(shift)
        descriptors += [np.linalg.norm(shift, axis=1, keepdims=True), shift[:, 1:2], spread, crowd - crowd.mean()]
    return np.concatenate(shifts, 1), np.concatenate(descriptors, 1)


def turned(shape: Prepared, angle: float) -> Prepared:
    """The shape turned about the up axis, in its new box. Invariant parts stay as they are, radii of the neighbourhoods
    included."""
    if angle == 0:
        return shape
    sin, cos = np.sin(angle), np.cos(angle)
    rotation = np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]], np.float32)
    position = shape.position @ rotation.T
    low, high = position.min(0), position.max(0)
    scale = float((high - low).max()) or 1.0
    position = (position - (low + high) / 2) / scale
    sides = (high - low) / scale
    shift = (shape.shift.reshape(len(position), -1, 3) @ rotation.T).reshape(len(position), -1)
    box = position / np.maximum(sides, THINNEST)
    return replace(shape, position=position, sides=sides, box=box, shift=shift, diameter=shape.diameter / scale)


def squared(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Squared distances (n, m) between rows of a (n, d) and b (m, d)."""
    return np.asarray(np.maximum((a * a).sum(1)[:, None] + (b * b).sum(1)[None] - 2 * a @ b.T, 0))


def descriptors(shape: Prepared, basis: np.ndarray, points: np.ndarray | slice = slice(None)) -> np.ndarray:
    """(n, c + g) float32 of some points, or of all: components of the features by the basis (channel, c), then the
    local geometry."""
    return np.concatenate([shape.features[points] @ basis, shape.geometry[points]], 1)
