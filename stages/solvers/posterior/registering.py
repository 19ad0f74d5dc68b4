"""Shots laid over a target: where their keypoints come to lie once the whole surface is matched by place and looks.

A few keypoints' mean places know nothing of the target but its box; a shot's surface, deformed smoothly onto the
target's, takes them along (Myronenko and Song, Point set registration: coherent point drift, 2010; with looks, and
matched from either side).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from b23d.stages.geometry.sampling import farthest_points
from b23d.stages.solvers.posterior.geometry import THINNEST, Prepared, squared
from b23d.stages.solvers.posterior.weighing import Weighed

SAMPLE = 150  # points of a surface that are matched
LOOKS = 8.0  # nats that two points cost whose looks have nothing in common
FIRST_SD, LAST_SD = 0.15, 0.05  # of matched points' distance, in longest box sides, from round to round
ROUNDS = 6
STIFF = 1.0  # how stiff the deformation is beside one match
SMOOTH = 0.35  # how far it reaches, in longest box sides
LEFT = 0.7  # of the variance of places, where shots agree
LEAST = 0.05  # shots that are less near to the target than this share of the nearest do not count for it


@dataclass(frozen=True)
class SpreadPoints:
    """m points of a shape, spread over it."""

    box: np.ndarray
    """(m, 3) in sides of the box."""
    looks: np.ndarray
    """(m, c) components of the features."""


def surface_of(shape: Prepared, basis: np.ndarray, count: int = SAMPLE) -> SpreadPoints:
    """basis: (channel, c)."""
    order = np.lexsort(shape.position.T)  # so that it does not depend on the candidates'
    at = order[farthest_points(shape.position[order], count)]
    return SpreadPoints(shape.box[at], shape.features[at] @ basis)


def laid_over(learned: Weighed, near: np.ndarray, target: Prepared) -> Weighed:
    """With places where the shots' keypoints come to lie on the target, the nearer shots', of near (s,), the more; and
    with deviations of what that leaves of them, and of how shots disagree. Ids that only other shots have stay where
    they were expected."""
    model = learned.model
    shown = (learned.shots[:, None] * model.has).any(0)
    surface, sides = surface_of(target, model.basis), np.maximum(target.sides, THINNEST).astype(np.float64)
    used = np.flatnonzero(near * learned.shots > LEAST * near.max())
    weights = (near * learned.shots)[used, None] * model.has[np.ix_(used, shown)]
    laid = np.array(
        [
            moved(
                model.places[shot, shown], SpreadPoints(model.surface[shot], model.surface_looks[shot]), surface, sides
            )
            for shot in used
        ]
    )  # (s, k, 3)
    times = weights.sum(0)
    told, often = times > 0, np.maximum(times, 1e-12)[:, None]
    places = np.where(told[:, None], np.einsum("sk,skd->kd", weights, laid) / often, learned.places)
    kept = np.where(told, LEFT**0.5, 1.0)
    apart = (laid - places) * sides * np.sqrt(weights / often.T)[..., None]
    disagreement = np.einsum("sid,sjd->ij", apart, apart) / 3
    return replace(learned, places=places, deviations=learned.deviations * np.outer(kept, kept) + disagreement)


def moved(places: np.ndarray, shot: SpreadPoints, target: SpreadPoints, sides: np.ndarray) -> np.ndarray:
    """Places (k, 3) on a shot as it is deformed onto the target of such box sides (3,): affinely, then smoothly."""
    points, others, kept = (one.astype(np.float64) * sides for one in (shot.box, target.box, places))
    unlike = -LOOKS * shot.looks.astype(np.float64) @ target.looks.T.astype(np.float64)
    affine = np.concatenate([points, np.ones((len(points), 1))], 1)
    smooth, where = _kernel(points, points), points
    for sd in np.geomspace(FIRST_SD, LAST_SD, ROUNDS):
        costs = unlike + squared(where, others) / (2 * sd**2)
        matches = _shares(costs, 1) + _shares(costs, 0)  # each point's among the target's, and the other way round
        times = matches.sum(1)
        wanted = matches @ others / times[:, None] - points
        weighted = affine.T * times
        linear = np.linalg.solve(weighted @ affine + 1e-3 * np.eye(4), weighted @ wanted)
        rest = np.linalg.solve(smooth + STIFF * np.diag(1 / times), wanted - affine @ linear)
        where = points + affine @ linear + smooth @ rest
    wide = np.concatenate([kept, np.ones((len(kept), 1))], 1)
    return np.asarray((kept + wide @ linear + _kernel(kept, points) @ rest) / sides)


def _kernel(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.asarray(np.exp(-squared(one, other) / (2 * SMOOTH**2)))


def _shares(costs: np.ndarray, axis: int) -> np.ndarray:
    likely = np.exp(costs.min(axis, keepdims=True) - costs)
    return np.asarray(likely / likely.sum(axis, keepdims=True))
