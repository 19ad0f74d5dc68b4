"""How much shapes are alike: where they have surface, and what they look like.

On KeypointNet's bathtubs, both together say more than either: how near keypoints lie to the weighted mean of the shots'
places, and which ids a shape has.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

CELLS = 10
"""Along each side of the cube that a box of longest side 1 lies in."""
BLUR = 0.6
"""Standard deviation, in cells, by which surfaces are blurred: shapes that nearly meet are nearly alike."""


def occupancy(position: np.ndarray) -> npt.NDArray[np.float32]:
    """(1000,) share of the points (n, 3) of a box, centred and of longest side 1, in every cell; x counts slowest, z
    fastest."""
    cell = np.clip(((position + 0.5) * CELLS).astype(np.int64), 0, CELLS - 1)
    flat = (cell[:, 0] * CELLS + cell[:, 1]) * CELLS + cell[:, 2]
    return (np.bincount(flat, minlength=CELLS**3) / max(len(position), 1)).astype(np.float32)


def overlap(one: np.ndarray, others: np.ndarray) -> npt.NDArray[np.float64]:
    """(s,) in 0 … 1, of one shape's occupancy (cell,) with others' (s, cell): what their blurred surfaces share of what
    they cover together (Ruzicka's similarity)."""
    return shared(one[None], others)[0]


def overlaps(occupancies: np.ndarray) -> npt.NDArray[np.float64]:
    """(m, m) as `overlap`, of every one of occupancies (m, cell) with every other."""
    return shared(occupancies, occupancies)


def shared(some: np.ndarray, others: np.ndarray) -> npt.NDArray[np.float64]:
    """(m, s) as `overlap`, of every one of occupancies (m, cell) with every one of others (s, cell)."""
    rest = _blurred(others)
    return np.array([np.minimum(own, rest).sum(1) / np.maximum(own, rest).sum(1) for own in _blurred(some)])


def cosine(one: np.ndarray, others: np.ndarray) -> npt.NDArray[np.float64]:
    """(s,) of one vector (c,) with others (s, c)."""
    lengths = np.linalg.norm(one.astype(np.float64)) * np.linalg.norm(others.astype(np.float64), axis=1)
    return np.asarray(others.astype(np.float64) @ one / np.maximum(lengths, 1e-12))


def standardised(values: np.ndarray) -> npt.NDArray[np.float64]:
    """With mean 0 and variance 1; all 0 where they do not differ."""
    spread = values.std()
    return np.asarray((values - values.mean()) / (spread if spread > 1e-9 else np.inf), np.float64)


def _blurred(occupancies: np.ndarray) -> np.ndarray:
    """(s, cell) → (s, cell)."""
    from scipy.ndimage import gaussian_filter

    grid = occupancies.reshape(-1, CELLS, CELLS, CELLS).astype(np.float64)
    blurred = gaussian_filter(grid, (0, BLUR, BLUR, BLUR), mode="constant")
    return np.asarray(blurred.reshape(len(occupancies), -1))
