"""Which parts of a mesh hang together, with vertices at equal places taken as one."""

from __future__ import annotations

import numpy as np

from b23d.stages.geodesics.graph import edge_graph, label_components


def weld(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The different places (p, 3) float64 among vertices (v, 3), and the faces (f, 3) int64 as indices into them."""
    places, welded = np.unique(vertices.astype(np.float64), axis=0, return_inverse=True)
    return places, welded.ravel()[faces]


def face_components(count: int, faces: np.ndarray) -> np.ndarray:
    """(f,) int32: the connected part each face (f, 3) of a welded mesh of `count` places is in; labels need not be
    dense."""
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]]])
    return label_components(edge_graph(count, edges, np.ones(len(edges))))[faces[:, 0]]
