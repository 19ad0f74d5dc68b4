"""Stray points and specks of a scan, which are no surface: few, small, and apart from all else (points as in Rusu et
al. 2008). They would reach out of the shape's frame, be drawn before it, and be candidates.

Small detached parts are no rarity in clean shapes. So what is alone must be as small as a scanner's errors are, and
lie where there are not several of its kind; what is larger is stray only where the box shrinks without it.
"""

from __future__ import annotations

import numpy as np

SMALL = 0.002
"""Faces that hang together and have a larger share of the area are a part of the shape."""
MOST = 0.05
"""Where more than this would be stray together, nothing is."""
GAP = 0.03
"""Stray faces are farther than this from the rest, in longest sides."""
SPECK, CLEAR, SIMPLE = 0.02, 0.015, 8
"""Faces that hang together and reach no farther than this, and are farther than that from the rest, in longest sides,
are stray wherever they are, if alone and no more than so many: a modelled knob or rivet has more."""
FEWEST, ENOUGH = 1000, 4096
"""Of fewer points in a cloud, distances to neighbours do not tell a stray one from a thin place; of fewer than
`ENOUGH`, only where the box shrinks without them."""
LEAST_SHARE = 0.003
"""Of a cloud's points, as with fewer than `ENOUGH`: a wire has a few that are far from the next."""
NEIGHBOUR, SPARSE, LEAST = 6, 3.0, 0.02
"""Stray points are farther from this neighbour than this many times the usual, and than this, in longest sides."""
APART = 2 / 3
"""… and none of a few together is nearer to the rest than this part of that."""
ABOVE, OFF, PATCH = 1.3, 2.5, 16
"""Single points farther than this many times the usual from all others are stray where they are as far, and this many
standard deviations, off the plane of so many nearest ones."""
BESIDE, STRAIGHT, FLAT = 8, 0.3, 0.1
"""Sparse points that lie with so many others along a line, or in a plane, are a part of the shape that a scanner saw
few points of: standard deviations across, as a part of those along."""
TOGETHER = 6
"""More than so many sparse points, or specks, that are no farther from the next than from the rest are a part of the
shape: a cable, a chain."""
SHRINK = 0.02
"""By what share the longest side has to be shorter without it for what is larger than a speck to be stray."""


def stray_points(points: np.ndarray) -> np.ndarray:
    """(n,) bool: points (n, 3) of a cloud, in its unit frame, that are stray: few together that are farther from others
    than is usual, or single ones above what is nearest to them."""
    from scipy.spatial import cKDTree

    none = np.zeros(len(points), bool)
    if len(points) < FEWEST:
        return none
    distance = cKDTree(points).query(points, k=NEIGHBOUR + 1)[0]
    usual = float(np.median(distance[:, -1]))
    stray = _sparse(points, distance[:, -1], max(LEAST, SPARSE * usual))
    stray |= _above(points, np.flatnonzero(~stray & (distance[:, 1] > ABOVE * usual)), ABOVE * usual)
    many = len(points) >= ENOUGH and stray.mean() > LEAST_SHARE
    return stray if 0 < stray.mean() <= MOST and (many or _shrinks(points, points[~stray])) else none


def _sparse(points: np.ndarray, distance: np.ndarray, limit: float) -> np.ndarray:
    """(n,) bool: points (n, 3) of which a few together are at a `distance` (n,) from neighbours beyond the limit, and
    none of these is near the rest."""
    from scipy.spatial import cKDTree

    stray = np.zeros(len(points), bool)
    sparse = np.flatnonzero(distance > limit)
    sparse = sparse[~_thin(points[sparse])]
    group, few = _few(points[sparse], limit)
    alone, group = sparse[few], group[few]
    stray[alone] = True
    near = cKDTree(points[~stray]).query(points[alone])[0] < APART * limit
    touches = np.bincount(group, near, minlength=len(sparse)) > 0
    stray[alone] = ~touches[group]
    return stray


def _thin(sparse: np.ndarray) -> np.ndarray:
    """(m,) bool: which of sparse points (m, 3) lie with the nearest others along a line or in a plane."""
    from scipy.spatial import cKDTree

    if len(sparse) <= BESIDE:
        return np.zeros(len(sparse), bool)
    near = sparse[cKDTree(sparse).query(sparse, k=BESIDE + 1)[1]].astype(np.float64)
    across = np.linalg.svd(near - near.mean(axis=1, keepdims=True), compute_uv=False)  # (m, 3), descending
    return np.asarray((across[:, 1] < STRAIGHT * across[:, 0]) | (across[:, 2] < FLAT * across[:, 0]))


def _above(points: np.ndarray, asked: np.ndarray, limit: float) -> np.ndarray:
    """(n,) bool: those `asked` (m,) of points (n, 3) that are more than the limit, and far more than others, off the
    plane of their neighbours: ends of sheets and wires are not."""
    from scipy.spatial import cKDTree

    above = np.zeros(len(points), bool)
    if len(asked):
        near = points[cKDTree(points).query(points[asked], k=PATCH + 1)[1][:, 1:]].astype(np.float64)
        middle = near.mean(axis=1, keepdims=True)
        spread, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", near - middle, near - middle) / PATCH)
        height = np.abs(np.einsum("ni,ni->n", points[asked] - middle[:, 0], axes[:, :, 0]))
        above[asked] = height > np.maximum(limit, OFF * np.sqrt(np.maximum(spread[:, 0], 0)))
    return above


def stray_faces(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """(f,) bool: faces (f, 3) of a mesh, vertices (v, 3) in its unit frame, that are stray. Groups are what shares
    vertices, or places of them."""
    from scipy.spatial import cKDTree

    from b23d.stages.geodesics.connectivity import face_components, weld
    from b23d.stages.geometry.cleaning import areas
    from b23d.stages.geometry.sampling import surface_samples

    none, shares = np.zeros(len(faces), bool), areas(vertices, faces)
    shares /= shares.sum()
    if not _small(face_components(len(vertices), faces), shares).any():
        return none
    places, welded = weld(vertices, faces)
    group = np.unique(face_components(len(places), welded), return_inverse=True)[1].ravel()
    small = _small(group, shares)
    rest = faces[~small]
    if not 0 < shares[small].sum() <= MOST:
        return none
    surface = surface_samples(vertices, rest, 20_000, np.random.default_rng(0)).points
    tree = cKDTree(np.concatenate([vertices[np.unique(rest)], surface]))
    distance = tree.query(vertices[faces[small]].reshape(-1, 3))[0].reshape(-1, 3).min(axis=1)
    nearest = np.full(int(group.max()) + 1, np.inf)
    np.minimum.at(nearest, group[small], distance)
    far, clear = small & (nearest[group] > GAP), small & (nearest[group] > CLEAR)
    if far.any() and _shrinks(vertices[faces], vertices[faces[~far]]):
        return far
    if clear.any():
        clear[clear] = _specks(vertices[faces[clear]], np.unique(group[clear], return_inverse=True)[1].ravel())
    return clear


def _small(group: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """(f,) bool: whether the group of each face has a small share of the area."""
    return np.asarray(np.bincount(group, shares)[group] <= SMALL)


def _specks(corners: np.ndarray, group: np.ndarray) -> np.ndarray:
    """(f,) bool: faces of these corners (f, 3, 3) whose `group` (f,), 0 … g - 1, is tiny, simple and one of few
    there."""
    low, high = np.full((int(group.max()) + 1, 3), np.inf), np.full((int(group.max()) + 1, 3), -np.inf)
    np.minimum.at(low, group, corners.min(axis=1))
    np.maximum.at(high, group, corners.max(axis=1))
    tiny = ((high - low).max(axis=1) <= SPECK) & (np.bincount(group) <= SIMPLE)
    return np.asarray(tiny & _few((low + high) / 2, GAP)[1])[group]


def _few(places: np.ndarray, reach: float) -> tuple[np.ndarray, np.ndarray]:
    """Which of places (m, 3) hang together, each within `reach` of another, as labels (m,), and (m,) bool: no more than
    a few do."""
    from scipy.spatial import cKDTree

    from b23d.stages.geodesics.graph import edge_graph, label_components

    if not len(places):
        return np.zeros(0, np.int32), np.zeros(0, bool)
    near = cKDTree(places).query_pairs(reach, output_type="ndarray")
    together = label_components(edge_graph(len(places), near, np.ones(len(near))))
    return together, np.asarray(np.bincount(together)[together] <= TOGETHER)


def _shrinks(before: np.ndarray, after: np.ndarray) -> bool:
    sides = [float(np.ptp(points.reshape(-1, 3), axis=0).max()) for points in (before, after)]
    return sides[1] < (1 - SHRINK) * sides[0]
