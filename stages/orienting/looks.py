"""What a surface looks like from each of its points, in a way that depends on how the shape stands."""

from __future__ import annotations

import numpy as np

from b23d.schemas.shape import Source, turned
from b23d.schemas.up_axis import UP_AXES, to_y_up
from b23d.stages.normalize import NormalizeParams, normalize
from b23d.stages.solvers.posterior.geometry import THINNEST, local_geometry, squared

RADII = (0.05, 0.1, 0.2)
"""Of the neighbourhoods, in largest box sides."""
ASKED = 160
"""Points of a shape that are compared with all those of an example: the farthest-point samples that come first."""


def sampled(source: Source, count: int) -> np.ndarray:
    """(n, 3) float64 farthest-point samples of the shape as its file stands, in its unit frame. Raises ValueError,
    naming the shape, as `normalize` does."""
    as_it_is = source.model_copy(update={"up": "y"})
    alone = NormalizeParams(candidates="fps", count=count, colors=False, max_nonfinite=1.0)
    return normalize(as_it_is, alone).points.astype(np.float64)


def described(points: np.ndarray) -> np.ndarray:
    """(n, 12) float32: each point's place in the box, and where the surface around it lies: mean-shift vectors."""
    return _placed(points, points.min(0), points.max(0), local_geometry(points.astype(np.float32), RADII)[0])


def hypotheses(turns: int) -> np.ndarray:
    """(6, turns, 3, 3) rotations: each axis to +y, then turned about it."""
    about = np.array([turned(360.0 * turn / turns) for turn in range(turns)])
    return np.array([about @ to_y_up(axis) for axis in UP_AXES])


def unlike(points: np.ndarray, examples: list[np.ndarray], rotations: np.ndarray) -> np.ndarray:
    """(…) how unlike the shape is to the example it is most alike to, rotated by each of `rotations` (…, 3, 3): mean
    distance between what its points look like and the most alike points of the example.

    points (n, 3) in farthest-point order; examples: what `described` gives of each.
    """
    shift = local_geometry(points.astype(np.float32), RADII)[0].reshape(len(points), -1, 3)[:ASKED]
    asked, flat = points[:ASKED], rotations.reshape(-1, 3, 3)
    found = np.empty(len(flat))
    for i, rotation in enumerate(flat):
        box = points @ rotation.T
        low, high = box.min(0), box.max(0)
        looks = _placed(asked @ rotation.T, low, high, (shift @ rotation.T).reshape(len(asked), -1))
        found[i] = min(float(np.sqrt(squared(looks, example).min(1)).mean()) for example in examples)
    return found.reshape(rotations.shape[:-2])


def _placed(points: np.ndarray, low: np.ndarray, high: np.ndarray, shift: np.ndarray) -> np.ndarray:
    sides = np.maximum(high - low, THINNEST * float((high - low).max()))
    return np.concatenate([(points - (low + high) / 2) / np.where(sides > 0, sides, 1), shift], axis=1).astype(
        np.float32
    )
