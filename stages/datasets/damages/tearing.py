"""Damages to how a mesh hangs together: soups of faces, in any order, wound either way."""

from __future__ import annotations

import numpy as np

from b23d.stages.datasets.damages.scan import Scan


def soup(scan: Scan, amount: float, rng: np.random.Generator) -> Scan:
    """`amount` of the faces, at random, with three vertices of their own; nothing moves."""
    _needs_faces("soup", scan)
    torn = rng.permutation(len(scan.faces))[: round(amount * len(scan.faces))]
    faces = scan.faces.copy()
    faces[torn] = len(scan.vertices) + np.arange(3 * len(torn)).reshape(-1, 3)
    whole = Scan(np.concatenate([scan.vertices, scan.vertices[scan.faces[torn]].reshape(-1, 3)]), faces)
    return whole.of(np.arange(len(faces)))


def shuffled(scan: Scan, amount: float, rng: np.random.Generator) -> Scan:
    """A soup in random order, with `amount` of its faces wound the other way; a cloud in random order."""
    if not len(scan.faces):
        return scan.of(rng.permutation(len(scan.vertices)))
    torn = soup(scan, 1.0, rng)
    faces = torn.faces[rng.permutation(len(torn.faces))]
    turned = rng.random(len(faces)) < amount
    faces[turned] = faces[turned][:, ::-1]
    return _reordered(Scan(torn.vertices, faces), rng)


def _reordered(scan: Scan, rng: np.random.Generator) -> Scan:
    """The same faces, over vertices in random order."""
    order = rng.permutation(len(scan.vertices))
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return Scan(scan.vertices[order], place[scan.faces])


def _needs_faces(what: str, scan: Scan) -> None:
    if not len(scan.faces):
        raise ValueError(f"{what}: expected a mesh to tear, got a cloud; choose another dataset.damage.kind")
