"""The geometry that damages work on: a mesh or a cloud, nothing else of a file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.stages.geometry.cleaning import Frame, areas


@dataclass(frozen=True)
class Scan:
    """A mesh, or a cloud where there are no faces."""

    vertices: np.ndarray
    """(v, 3) float64, source frame, finite."""
    faces: np.ndarray
    """(f, 3) int64."""

    @property
    def size(self) -> float:
        """Longest side of the box of all vertices."""
        return Frame.around(self.vertices).scale

    def places(self) -> np.ndarray:
        """(f, 3) middles of the faces; a cloud's points."""
        return self.vertices[self.faces].mean(axis=1) if len(self.faces) else self.vertices

    def weights(self) -> np.ndarray:
        """(f,) share of the surface of each of `places`; equal ones for a cloud's points."""
        each = areas(self.vertices, self.faces) if len(self.faces) else np.ones(len(self.vertices))
        return np.asarray(each / each.sum())

    def of(self, kept: np.ndarray) -> Scan:
        """What is left where of `places` only `kept` (f,) bool or indices stay; vertices that no face uses go."""
        if not len(self.faces):
            return Scan(self.vertices[kept], self.faces)
        used, faces = np.unique(self.faces[kept], return_inverse=True)
        return Scan(self.vertices[used], faces.reshape(-1, 3))

    def fine(self, side: float) -> Scan:
        """The same surface with no edge of a face longer than `side`; a cloud as it is."""
        if not len(self.faces):
            return self
        from trimesh.remesh import subdivide_to_size

        vertices, faces = subdivide_to_size(self.vertices, self.faces, side, max_iter=20)
        return Scan(np.asarray(vertices, np.float64), np.asarray(faces, np.int64))

    def normals(self) -> np.ndarray:
        """(v, 3) unit normals: means of a place's faces by area; for a cloud of its nearest points, sign arbitrary."""
        if not len(self.faces):
            from b23d.stages.geodesics.shortcuts import cloud_normals

            return cloud_normals(self.vertices)
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        flat = np.repeat(np.cross(b - a, c - a), 3, axis=0)
        place = one_place(self.vertices)
        sums = np.stack([np.bincount(place[self.faces.ravel()], flat[:, i], len(place)) for i in range(3)], axis=1)
        found: np.ndarray = (sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-300))[place]
        return found


def one_place(vertices: np.ndarray) -> np.ndarray:
    """(v,) a number for each vertex that those at the very same place share; less than v."""
    return np.unique(vertices, axis=0, return_inverse=True)[1].ravel()
