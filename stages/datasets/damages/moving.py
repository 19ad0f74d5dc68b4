"""Damages that leave the surface whole: noise, another density, another pose."""

from __future__ import annotations

import numpy as np

from b23d.schemas.shape import turned
from b23d.stages.datasets.damages.scan import Scan, one_place

MOST_FACES = 5_000_000
"""Of what is cut finer: more would take memory, and show no more."""


def noise(scan: Scan, amount: float, rng: np.random.Generator) -> Scan:
    """Every place moved along its normal by a normal deviate, of standard deviation `amount` sizes; vertices at one
    place move together, so that nothing tears."""
    along = rng.normal(scale=amount * scan.size, size=len(scan.vertices))[one_place(scan.vertices)]
    return Scan(scan.vertices + along[:, None] * scan.normals(), scan.faces)


def uneven(scan: Scan, amount: float, rng: np.random.Generator) -> Scan:
    """`amount` (1 or more) times as many points at the front (-z) as at the back, exponentially less in between: a
    cloud loses points; a mesh's front half is cut into smaller faces. Raises ValueError where those were too many."""
    z = scan.places()[:, 2]
    back = (z - z.min()) / max(float(np.ptp(z)), 1e-300)  # 0 at the front, 1 at the back
    if not len(scan.faces):
        return scan.of(rng.random(len(z)) <= amount**-back)
    front, rest = scan.of(back < 0.5), scan.of(back >= 0.5)
    rounds = int(np.ceil(np.log(amount) / np.log(4)))
    if (count := len(front.faces) * 4.0**rounds) > MOST_FACES:
        raise ValueError(
            f"uneven: expected at most {MOST_FACES:,} faces at the front, got {count:,.0f}; set a smaller "
            "dataset.damage.amount"
        )
    for _ in range(rounds):
        front = _quartered(front)
    return Scan(
        np.concatenate([front.vertices, rest.vertices]), np.concatenate([front.faces, rest.faces + len(front.vertices)])
    )


def posed(positions: np.ndarray, kind: str, amount: float) -> np.ndarray:
    """Positions (n, 3) of the clean shape on the damaged one: `turned` by `amount` degrees about the up axis; `scaled`
    by `amount`, and moved by as much; as they are under any other damage."""
    if kind == "turned":
        return np.asarray(positions @ turned(amount).T)
    if kind == "scaled":
        return np.asarray(positions * amount + amount)
    return positions


def _quartered(scan: Scan) -> Scan:
    from trimesh.remesh import subdivide

    vertices, faces = subdivide(scan.vertices, scan.faces)
    return Scan(np.asarray(vertices, np.float64), np.asarray(faces, np.int64))
