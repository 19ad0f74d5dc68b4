"""What tells a shape's front from its back: how its surface differs from itself turned half round.

A few keypoints may look much the same from either end, a bathtub's or a bed's; the surface as a whole says more. Of
KeypointNet's beds, turned at random, three shots' contrast by itself tells .72 of the fronts, of its bathtubs .66;
keypoints' evidence .73 and .63, both .74 and .65 (10 draws, sd over draws .13 … .18; block 9 of the saliency ViT).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from b23d.stages.solvers.posterior.geometry import NOTHING, THINNEST, Prepared, descriptors, squared, turned

GRID = (6, 4, 6)
"""Cells along x, y and z of the box."""
REACH = 0.1
"""Standard deviation of the neighbourhood that a cell averages over, in box sides."""
EVIDENT = 0.1
"""A contrast of this share of what is seen counts half: less may be chance, and where there is none nothing is told."""
CLIPPED = 3.0
"""Standard deviations of the local geometry beyond which it counts as this."""


def contrast(
    shape: Prepared, basis: np.ndarray, mean: np.ndarray, scale: np.ndarray, angle: float
) -> npt.NDArray[np.float32]:
    """(m,) by how much each cell of half the box differs from the one that a half turn takes it to, in components of
    the features and in the standardised local geometry, which count alike: each of length 0 … 1 as it is evident. The
    shape turned half round has the negative.

    basis (channel, c), mean and scale (c + g,) of the descriptors; angle: by which the shape is turned before.
    """
    stood = turned(shape, angle)
    weights = np.exp(np.maximum(squared(_CELLS, stood.box.astype(np.float64)) / (-2 * REACH**2), NOTHING))
    crowd = weights.sum(1)
    mass = np.sqrt(np.minimum(crowd, crowd[_OPPOSITE]) / len(stood.box))[:, None]
    described, c = descriptors(shape, basis) - mean, basis.shape[1]
    parts = []
    for values in (described[:, :c], np.clip(described[:, c:] / scale[c:], -CLIPPED, CLIPPED)):
        seen = weights @ values / (crowd[:, None] + 1e-3)
        odd = ((seen - seen[_OPPOSITE]) * mass)[: len(_CELLS) // 2]
        length, floor = float(np.linalg.norm(odd)), EVIDENT * float(np.linalg.norm(seen * mass))
        parts.append(odd.ravel() * (length / max(length**2 + floor**2, 1e-24)))
    return np.concatenate(parts).astype(np.float32)


def lying_along(shapes: list[Prepared]) -> float:
    """The angle, less than a quarter turn in whole degrees, in radians, by which shapes of one frame are turned to lie
    along the axes: the floors of their boxes are smallest, as a product of areas."""
    angles = np.deg2rad(np.arange(90))
    areas = np.zeros(len(angles))
    for shape in shapes:
        x, z = shape.position[:, 0].astype(np.float64), shape.position[:, 2].astype(np.float64)
        for i, (sin, cos) in enumerate(zip(np.sin(angles), np.cos(angles), strict=True)):
            wide, deep = np.ptp(cos * x + sin * z), np.ptp(cos * z - sin * x)
            areas[i] += np.log(max(wide, THINNEST)) + np.log(max(deep, THINNEST))
    return float(angles[areas.argmin()])


def _cells() -> tuple[np.ndarray, np.ndarray]:
    """Their centres (cell, 3) in the box, x slowest, so that the second half is opposite to the first; and (cell,) the
    cell opposite to each."""
    axes = [(np.arange(count) + 0.5) / count - 0.5 for count in GRID]
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), -1)
    number = np.arange(centres[..., 0].size).reshape(GRID)
    return centres.reshape(-1, 3), number[::-1, :, ::-1].ravel()


_CELLS, _OPPOSITE = _cells()
