"""Two isometric cubes: one side dented inwards, or outwards by the same amount.

The paper's example (section "Geometric Properties", figure "geodesic-boxes") of shapes that differ although
every distance along their surfaces is the same: HKS and WKS cannot tell them apart, back-projected features can.
"""

from __future__ import annotations

import numpy as np

from b23d.stages.datasets.procedural.solids import Solid, block


def isometric_cubes(cells: int = 16, depth: float = 0.2, reach: float = 0.36) -> tuple[Solid, Solid]:
    """The unit cube with its upper side dented inwards, and outwards: (in, out), same connectivity, same edge lengths.

    The upper side lies in y = 0, so that its dent's mirror image is exact. `cells`: cells along an edge (even).
    `depth`: of the dent, at its middle; `reach`: its radius, less than .5. The dent is (1 - (r / reach)²)² times its
    depth: smooth, and 0 at and beyond its rim. A dent is a graph over the side, so mirroring it in the side's plane
    changes no length in it.

    Raises ValueError where the dent would reach the side's edge or the opposite side.
    """
    if not (0 < reach < 0.5 and 0 < depth < 1):
        raise ValueError(
            f"isometric cubes: expected 0 < reach < 0.5 and 0 < depth < 1, got {reach} and {depth}; "
            "make the dent smaller"
        )

    def dented(sign: float) -> Solid:
        def place(lattice: np.ndarray) -> np.ndarray:
            x, z = lattice[:, 0] / 2, lattice[:, 2] / 2
            dent = depth * np.maximum(0.0, 1 - (x**2 + z**2) / reach**2) ** 2
            return np.stack([x, np.where(lattice[:, 1] == 1, sign * dent, (lattice[:, 1] - 1) / 2), z], -1)

        return block((cells, cells, cells), place)

    return dented(-1.0), dented(1.0)
