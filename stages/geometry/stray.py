"""Stray points and specks of a scan: few, small, and far from all else, so that the shape's frame must not reach to
them (points as in Rusu et al. 2008).

Small detached parts are no rarity in clean shapes, so nothing is stray unless the box shrinks without it.
"""

from __future__ import annotations

import numpy as np

SMALL = 0.002
"""Faces that hang together and have a larger share of the area are a part of the shape."""
MOST = 0.05
"""Where more than this would be stray together, nothing is."""
GAP = 0.03
"""Stray faces are farther than this from the rest, in longest sides."""
FEWEST = 1000
"""Of fewer points in a cloud, distances to neighbours do not tell a stray one from a thin place."""
NEIGHBOUR, SPARSE, LEAST = 6, 3.0, 0.02
"""Stray points are farther from this neighbour than this many times the usual, and than this, in longest sides."""
SHRINK = 0.02
"""By what share the longest side has to be shorter without what is stray."""


def stray_points(points: np.ndarray) -> np.ndarray:
    """(n,) bool: points (n, 3) of a cloud, in its unit frame, that are stray: farther from their sixth neighbour than
    is usual."""
    from scipy.spatial import cKDTree

    none = np.zeros(len(points), bool)
    ends = points[:, int(np.ptp(points, axis=0).argmax())]
    if len(points) < FEWEST or _reaches(ends, ends, np.full(len(points), 1 / len(points))):
        return none
    distance = cKDTree(points).query(points, k=NEIGHBOUR + 1)[0][:, -1]
    stray = distance > max(LEAST, SPARSE * float(np.median(distance)))
    return stray if 0 < stray.mean() <= MOST and _shrinks(points, points[~stray]) else none


def stray_faces(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(f,) bool: faces (f, 3) of a mesh, vertices (v, 3) in its unit frame, that are stray. Groups are what shares
    vertices, or places of them."""
    from scipy.spatial import cKDTree

    from b23d.stages.geodesics.connectivity import face_components, weld
    from b23d.stages.geometry.cleaning import areas
    from b23d.stages.geometry.sampling import surface_samples

    none, shares = np.zeros(len(faces), bool), areas(vertices, faces)
    shares /= shares.sum()
    axis = int(np.ptp(vertices[faces].reshape(-1, 3), axis=0).argmax())
    along = vertices[:, axis][faces]
    if _reaches(along.min(axis=1), along.max(axis=1), shares):
        return none
    places, welded = weld(vertices, faces)
    group = face_components(len(places), welded)
    small = np.bincount(group, shares)[group] <= SMALL
    rest = faces[~small]
    if not 0 < shares[small].sum() <= MOST or not _shrinks(vertices[faces], vertices[rest]):
        return none
    surface = surface_samples(vertices, rest, 20_000, np.random.default_rng(0)).points
    tree = cKDTree(np.concatenate([vertices[np.unique(rest)], surface]))
    distance = tree.query(vertices[faces[small]].reshape(-1, 3))[0].reshape(-1, 3).min(axis=1)
    nearest = np.full(int(group.max()) + 1, np.inf)
    np.minimum.at(nearest, group[small], distance)
    stray = small & (nearest[group] > GAP)
    return stray if _shrinks(vertices[faces], vertices[faces[~stray]]) else none


def _reaches(low: np.ndarray, high: np.ndarray, shares: np.ndarray) -> bool:
    """Whether at both ends of the longest side there is more than could be stray, a quick no: `low`, `high` (n,) along
    it of what has these `shares`."""
    layer = SHRINK / 2 * (high.max() - low.min())
    ends = (low < low.min() + layer, high > high.max() - layer)
    return all(float(shares[end].sum()) > MOST for end in ends)


def _shrinks(before: np.ndarray, after: np.ndarray) -> bool:
    sides = [float(np.ptp(points.reshape(-1, 3), axis=0).max()) for points in (before, after)]
    return sides[1] < (1 - SHRINK) * sides[0]
