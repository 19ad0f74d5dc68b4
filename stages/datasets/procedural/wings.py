"""Wings, tails and fins: airfoil sections joined along the span."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.stages.datasets.procedural.solids import Solid, loft, refined


@dataclass(frozen=True)
class Section:
    """An airfoil: its leading edge (3,), its chord along +z, its thickness as a share of the chord, and its bank.

    `bank`: angle in radians between its upper side and +y, towards -x: a right wing's dihedral at that place.
    """

    leading: tuple[float, float, float]
    chord: float
    thickness: float
    bank: float = 0.0

    def trailing(self) -> np.ndarray:
        return np.array(self.leading) + np.array([0.0, 0.0, self.chord])


def span(sections: list[Section], step: float) -> Solid:
    """Both wings in one piece, from the right one's sections: the first at x = 0 with bank 0, the last the right tip.

    The last vertex is the middle of the right tip's flat end.
    """
    up = np.array([[-np.sin(s.bank), np.cos(s.bank), 0.0] for s in sections])
    right = refined(_rings(sections, up), step)
    right[0, :, 0] = 0.0
    return loft(np.concatenate([right[:0:-1] * np.array([-1.0, 1.0, 1.0]), right]), mirror="along")


def fin(sections: list[Section], step: float) -> Solid:
    """An upright surface in the plane x = 0, from its lowest section to its highest. The last vertex is the top's
    middle."""
    sideways = np.tile(np.array([1.0, 0.0, 0.0]), (len(sections), 1))
    return loft(refined(_rings(sections, sideways), step))


def edges(sections: list[Section]) -> tuple[np.ndarray, np.ndarray]:
    """Leading and trailing edge (m, 3) from tip to root."""
    outside_in = sections[::-1]
    return np.array([s.leading for s in outside_in]), np.stack([s.trailing() for s in outside_in])


def _rings(sections: list[Section], up: np.ndarray) -> np.ndarray:
    """Sections as rings (m, 20, 3): vertex 0 the leading edge, then the upper side, the trailing edge, the lower
    side."""
    share = (1 - np.cos(np.linspace(0.0, np.pi, 11))) / 2
    # half the thickness of a NACA four-digit section, closed at the trailing edge
    half = 5 * (0.2969 * np.sqrt(share) - 0.1260 * share - 0.3516 * share**2 + 0.2843 * share**3 - 0.1036 * share**4)
    half[[0, -1]] = 0.0
    backward = np.concatenate([share, share[-2:0:-1]])
    upward = np.concatenate([half, -half[-2:0:-1]])
    leading = np.array([s.leading for s in sections])[:, None]
    chord = np.array([s.chord for s in sections])[:, None, None]
    thickness = np.array([s.thickness for s in sections])[:, None, None]
    return leading + chord * (backward[:, None] * np.array([0.0, 0.0, 1.0]) + thickness * upward[:, None] * up[:, None])
