"""Annotated keypoints on a shape's candidates, and whether they lie on the shape at all."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from b23d.schemas.keypoints import Keypoints
from b23d.schemas.shape import NormalizedShape

FARTHEST = 1e9
"""Keypoints farther than this, in longest sides, have no known cause; much farther, their squares overflow."""
TOLD, LOOSE = 5.0, 10.0
"""Keypoints within so many times `together` are told; within so many, refused if a mistake explains it exactly."""
MEND = "mend the annotation file, or raise stages.annotation.refuse"


def check_keypoints(keypoints: Keypoints, shape: NormalizedShape, name: str = "the shape") -> None:
    """Raise ValueError where a keypoint's point index lies beyond the data set's cloud.

    Only the geometry tells how long the cloud is, so this cannot be checked when the annotation is read. Where the
    candidates are not that cloud, indices are not used and not checked.
    """
    if shape.candidates != "cloud":
        return
    wrong = np.flatnonzero(keypoints.point_indices >= len(shape.points))
    if len(wrong):
        first = int(wrong[0])
        raise ValueError(
            f"keypoint {keypoints.ids[first]} of {name}: expected a point index below {len(shape.points)}, "
            f"got {keypoints.point_indices[first]}; mend the annotation file"
        )


def keypoint_candidates(keypoints: Keypoints, shape: NormalizedShape, name: str = "the shape") -> npt.NDArray[np.int64]:
    """The candidate of each keypoint: (k,) indices into `shape.points`.

    Its point index where the candidates are the data set's cloud and the annotation has one; else the candidate nearest
    to its position, however far (`check_annotation` tells how far). Raises ValueError as `check_keypoints`.
    """
    check_keypoints(keypoints, shape, name)
    if shape.candidates == "cloud" and (keypoints.point_indices >= 0).all():
        return keypoints.point_indices.astype(np.int64)
    from scipy.spatial import cKDTree

    unit = shape.to_unit(keypoints.positions)
    _, nearest = cKDTree(shape.points.astype(np.float64)).query(unit)
    nearest = np.asarray(nearest, np.int64).reshape(-1)
    if shape.candidates == "cloud":
        return np.where(keypoints.point_indices >= 0, keypoints.point_indices, nearest)
    return nearest


def check_annotation(
    keypoints: Keypoints, shape: NormalizedShape, warn: float, refuse: float, together: float
) -> tuple[npt.NDArray[np.float32], list[str]]:
    """Each keypoint's distance from the surface (k,), and what is odd: keypoints farther than `warn`, unit frame.

    Distances below `warn` may be upper bounds. Of a cloud, its spacing is allowed besides. Raises ValueError where one
    is farther than `refuse`, or where one known mistake explains exactly why some are farther than `warn`: the worst
    keypoint, its distance and the likely cause; where the keypoints lie all `together`; and where a point index lies
    beyond the cloud, or farther than `refuse` from the keypoint.
    """
    check_keypoints(keypoints, shape)
    if not len(keypoints.ids):
        return np.zeros(0, np.float32), []
    spacing = _spacing(shape) if "cloud" in (shape.kind, shape.candidates) else 0.0
    slack = spacing if shape.kind == "cloud" else 0.0
    unit = shape.to_unit(keypoints.positions)
    if (far := np.flatnonzero(np.abs(unit).max(axis=1) > FARTHEST)).size:
        at = ", ".join(f"{c:.6g}" for c in keypoints.positions[far[0]])
        raise ValueError(
            f"expected keypoints on the shape's surface, got keypoint {keypoints.ids[far[0]]} at ({at}), more than "
            f"{FARTHEST:.0e} longest sides away; {MEND}"
        )
    distances = _surface_distances(unit, shape, warn + slack)
    warnings = _on_surface(keypoints, shape, distances, warn + slack, refuse + slack)
    warnings += _apart(keypoints, shape, together, told=bool(warnings))
    warnings += _as_indexed(keypoints, shape, warn + spacing, refuse + spacing)
    return distances.astype(np.float32), warnings


def _on_surface(
    keypoints: Keypoints, shape: NormalizedShape, distances: np.ndarray, warn: float, refuse: float
) -> list[str]:
    beyond = distances > warn
    if not beyond.any():
        return []
    worst = int(distances.argmax())
    at = ", ".join(f"{c:.6g}" for c in keypoints.positions[worst])
    got = f"keypoint {keypoints.ids[worst]} at ({at}), {_sides(distances[worst])} away"
    if beyond.sum() > 1:
        got += f" ({beyond.sum()} of {len(beyond)} are beyond {_sides(warn)})"
    reason, exact = _likely(keypoints, shape, beyond, float(distances[worst]))
    told = f"expected keypoints on the shape's surface, got {got}; {reason}"
    if distances[worst] > refuse or exact:
        if not exact:
            raise ValueError(f"{told}; {MEND}")
        # What one mistake explains exactly is refused from `warn` on, and `warn` may not be above `refuse`.
        limits = "refuse and stages.annotation.warn" if distances[worst] > refuse else "warn"
        raise ValueError(f"{told}; mend the annotation file, or raise stages.annotation.{limits}")
    return [told]


def _likely(keypoints: Keypoints, shape: NormalizedShape, beyond: np.ndarray, worst: float) -> tuple[str, bool]:
    """The likely cause, and whether it is one mistake that explains every keypoint exactly."""
    from b23d.stages.geometry.misplaced import EXACT, cause

    found = cause(keypoints.positions, shape, _dense(shape))
    exact = found is not None and found.single and found.distance <= min(EXACT, worst / 4) and len(beyond) >= 4
    if beyond.sum() <= len(beyond) / 3 and not exact:
        alone = "this one alone seems" if beyond.sum() == 1 else "only these seem"
        return f"the other {(~beyond).sum()} lie on it: {alone} misplaced", False
    if found is not None:
        return f"likely {found.words}", exact
    return "no unit, frame or order of axes explains it: is it another shape's annotation?", False


def _apart(keypoints: Keypoints, shape: NormalizedShape, together: float, told: bool) -> list[str]:
    """Whether the keypoints are apart: too small by far, they all fall where the shape's origin is, and if it stands
    there, that is on its surface.

    Three and more that lie together are refused, and more than three within `LOOSE` times that if one mistake explains
    exactly why they do. Two that lie together are told, and three and more within `TOLD` times that.
    """
    from b23d.stages.geometry.misplaced import EXACT, cause

    unit = shape.to_unit(keypoints.positions)
    k, reach = len(unit), float(np.ptp(unit, axis=0).max())
    refused = k > 2 and reach < together
    if k < 2 or not (reach < together or (reach < LOOSE * together and k > 2 and not told)):
        return []
    found = cause(keypoints.positions, shape, _dense(shape))
    if not refused and k > 3 and found is not None and found.single:
        refused = found.distance <= min(EXACT, float(_surface_distances(unit, shape, 0.0).max()) / 4)
    if not refused and k > 2 and reach >= TOLD * together:
        return []
    at = ", ".join(f"{c:.6g}" for c in keypoints.positions[0])
    likely = f"likely {found.words}" if found else "are they in another unit or frame?"
    words = (
        f"expected keypoints apart from each other, got all {k} within {_sides(reach)}, keypoint {keypoints.ids[0]} at "
        f"({at}); {likely}"
    )
    if refused:
        raise ValueError(f"{words}; mend the annotation file, or lower stages.annotation.together")
    return [f"{words}; if they are meant to, lower stages.annotation.together"]


def _as_indexed(keypoints: Keypoints, shape: NormalizedShape, warn: float, refuse: float) -> list[str]:
    """Whether the cloud's points that the annotation names are where its keypoints are."""
    indices = keypoints.point_indices
    if shape.candidates != "cloud" or not (indices >= 0).any():
        return []
    named = np.flatnonzero(indices >= 0)
    unit = shape.to_unit(keypoints.positions[named])
    apart = np.linalg.norm(shape.points[indices[named]].astype(np.float64) - unit, axis=1)
    worst = int(apart.argmax())
    if apart[worst] <= warn:
        return []
    one = named[worst]
    told = (
        f"expected keypoint {keypoints.ids[one]} where the cloud has point {indices[one]}, got its xyz "
        f"{_sides(apart[worst])} away ({(apart > warn).sum()} of {len(apart)} disagree); "
        "likely point_index counts another cloud"
    )
    if apart[worst] > refuse:
        raise ValueError(f"{told}; drop pcd_info, or {MEND}")
    return [told]


def _surface_distances(unit: np.ndarray, shape: NormalizedShape, enough: float) -> npt.NDArray[np.float64]:
    """(k,) from the surface, unit frame; where a candidate is within `enough`, from that."""
    from scipy.spatial import cKDTree

    distances = np.asarray(cKDTree(shape.points.astype(np.float64)).query(unit)[0], np.float64).reshape(-1)
    far = distances > enough
    if far.any() and len(shape.faces):
        from b23d.stages.geometry.nearest import nearest_on_faces

        distances[far] = nearest_on_faces(unit[far], shape.vertices.astype(np.float64), shape.faces)[1]
    elif far.any():
        distances[far] = cKDTree(shape.vertices.astype(np.float64)).query(unit[far])[0]
    return distances


def _dense(shape: NormalizedShape) -> npt.NDArray[np.float64]:
    """Places on the surface, unit frame."""
    if not len(shape.faces):
        return shape.vertices.astype(np.float64)
    from b23d.stages.geometry.nearest import cover

    vertices = shape.vertices.astype(np.float64)
    covered = cover(vertices, shape.faces).points
    return np.concatenate([covered, vertices[np.unique(shape.faces)], shape.points.astype(np.float64)])


def _spacing(shape: NormalizedShape) -> float:
    """How far a place on the surface may be from a cloud's nearest point, unit frame: as far as all but the loneliest
    points are from their nearest others, and somewhat more (at a corner, fewer are near)."""
    from scipy.spatial import cKDTree

    points = (shape.vertices if shape.kind == "cloud" else shape.points).astype(np.float64)
    if len(points) < 2:
        return 0.0
    some = points[:: max(1, len(points) // 2000)]
    return 1.3 * float(np.quantile(cKDTree(points).query(some, k=2)[0][:, 1], 0.99))


def _sides(distance: float) -> str:
    return f"{distance:.3g} longest sides"
