"""Where another system's points lie on a shape's candidates."""

from __future__ import annotations

import numpy as np

from b23d.schemas.shape import NormalizedShape

FAR = 0.1
"""Half of a file's points farther than this from the shape (unit frame): it is in another frame, or about another
shape."""


def in_unit_frame(points: np.ndarray, shape: NormalizedShape, frame: str) -> np.ndarray:
    """Points (k, 3) of `frame` ("source" or "unit") in the unit frame, float64."""
    return points.astype(np.float64) if frame == "unit" else shape.to_unit(points)


def nearest_candidates(
    name: str, points: np.ndarray, shape: NormalizedShape, frame: str
) -> tuple[np.ndarray, np.ndarray]:
    """The candidate nearest to each point, (k,), and its distance in the unit frame.

    Raises ValueError, naming the shape: points that are not finite, or half of them not near the shape.
    """
    from scipy.spatial import cKDTree

    if not np.isfinite(points).all():
        raise ValueError(f"{name}: expected finite points, got NaN or infinity; mend the file")
    gaps, at = cKDTree(shape.points.astype(np.float64)).query(in_unit_frame(points, shape, frame))
    if len(gaps) and np.median(gaps) > FAR:
        raise ValueError(
            f"{name}: expected points on the shape, got half of them farther than {np.median(gaps):.3g} from it "
            f'(longest side 1); are they in the {frame} frame, of this shape? set frame to "source" or "unit"'
        )
    return at.astype(np.int64), gaps
