"""What lies around a keypoint on the shots, shifted onto what lies around where it was found on a target.

Laid over as a whole, a shot's surface takes a keypoint near its place; the surface right around it says where within
that. Points are matched softly by place and looks, and the neighbourhood follows them without turning or stretching
(iterative closest points: Besl and McKay, 1992): it is too small to tell more than a shift.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.stages.solvers.posterior.geometry import Prepared, squared
from b23d.stages.solvers.posterior.registering import LEAST
from b23d.stages.solvers.posterior.weighing import Weighed

REACH = 0.15  # how far a shot's neighbourhood goes, in longest box sides
WIDER = 1.5  # times as far the target's goes, for the shot's to be found in it
POINTS, TARGET_POINTS = 64, 128  # of them
LOOKS = 12.0  # nats that two points cost whose looks have nothing in common
FIRST_SD, LAST_SD = 0.06, 0.02  # of matched points' distance, in longest box sides, from round to round
ROUNDS = 5
SD = 0.03  # by which a keypoint lies off where a shot's neighbourhood comes to lie, in longest box sides
NEAREST = 5  # shots that are asked at most


@dataclass(frozen=True)
class Neighbourhoods:
    """m points around each of g."""

    places: np.ndarray
    """(g, m, 3) float32, in longest box sides, from the point that they lie around."""
    looks: np.ndarray
    """(g, m, c) components of their features."""


def around(shape: Prepared, points: np.ndarray, basis: np.ndarray, reach: float, count: int) -> Neighbourhoods:
    """Of points (g,), within so far of each, of which there is at least the point itself: evenly, in order of place, so
    that it does not depend on the candidates'; where there are fewer, some count twice. basis: (channel, c)."""
    order = np.lexsort(shape.position.T)
    rows = np.zeros((len(points), count), np.int64)
    for row, centre in zip(rows, shape.position[points], strict=True):
        within = order[((shape.position[order] - centre) ** 2).sum(1) <= reach**2]
        row[:] = within[np.linspace(0, len(within) - 1, count).round().astype(np.int64)]
    looks = (shape.features[rows.ravel()] @ basis).reshape(*rows.shape, basis.shape[1])
    return Neighbourhoods(shape.position[rows] - shape.position[points][:, None], looks)


def told_by_neighbourhoods(learned: Weighed, near: np.ndarray, target: Prepared, points: np.ndarray) -> np.ndarray:
    """(k, n) cost of each candidate for being off where the neighbourhoods of the shots, the nearer ones', of near
    (s,), the more, come to lie when they set out from points (k,); 0 for ids that none of the nearest shots has."""
    model = learned.model
    weights = near * learned.shots
    nearest = np.argsort(-weights, kind="stable")[:NEAREST]
    nearest = nearest[weights[nearest] > LEAST * weights.max()]
    columns = np.flatnonzero((learned.shots[:, None] * model.has).any(0))
    here = around(target, points, model.basis, REACH * WIDER, TARGET_POINTS)
    costs = np.zeros((len(points), len(target.position)))
    for i, (column, point) in enumerate(zip(columns, points, strict=True)):
        asked = nearest[model.has[nearest, column]]
        if len(asked):
            there = Neighbourhoods(model.around[asked, column], model.around_looks[asked, column])
            places = target.position[point] + shifts(there, Neighbourhoods(here.places[i], here.looks[i]))
            off = squared(places.astype(np.float64), target.position.astype(np.float64)) / (2 * SD**2)
            costs[i] = weights[asked] @ off / weights[asked].sum()
    return costs


def shifts(those: Neighbourhoods, here: Neighbourhoods) -> np.ndarray:
    """(j, 3) by which each of j neighbourhoods is shifted to lie on one, of places (t, 3) and looks (t, c)."""
    unlike = -LOOKS * those.looks.astype(np.float32) @ here.looks.T
    shift = np.zeros((len(those.places), 3), np.float32)
    for sd in np.geomspace(FIRST_SD, LAST_SD, ROUNDS):
        where = those.places + shift[:, None]
        costs = unlike + squared(where.reshape(-1, 3), here.places).reshape(unlike.shape) / np.float32(2 * sd**2)
        matches = np.exp(costs.min(2, keepdims=True) - costs)
        matches /= matches.sum(2, keepdims=True)
        shift = (matches @ here.places - those.places).mean(1)
    return shift
