"""From what a method says of itself to a probability: a logistic map of two numbers, moved from what development
classes gave towards what held-out shots say, as far as there are enough of them.

Platt, Probabilistic outputs for support vector machines, 1999, with a Gaussian prior on the map: three shots cannot
overfit it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LEAST = 1e-3  # probabilities are kept this far from 0 and 1 before their log-odds are taken


@dataclass(frozen=True)
class LogisticMap:
    """P = σ(offset + slope · log-odds of what is said)."""

    offset: float
    slope: float

    def __call__(self, said: np.ndarray) -> np.ndarray:
        """Of numbers in 0 … 1, ascending with them."""
        return np.asarray(1 / (1 + np.exp(-(self.offset + self.slope * log_odds(said)))))


def log_odds(probability: np.ndarray) -> np.ndarray:
    """Finite, of 0 … 1."""
    kept = np.clip(np.asarray(probability, np.float64), LEAST, 1 - LEAST)
    return np.log(kept / (1 - kept))


def fitted(
    said: np.ndarray, true: np.ndarray, prior: LogisticMap, sd: tuple[float, float] = (2.0, 0.5), weight: float = 1.0
) -> LogisticMap:
    """The most probable map for what was said (n,) and whether it was true (n,), given a Gaussian prior: about `prior`,
    of standard deviations `sd` of offset and slope. Never descending.

    weight: of each observation; below 1 where several are of one shape and so tell less than as many of their own.
    """
    from scipy.optimize import minimize

    odds, right = np.stack([np.ones(len(said)), log_odds(said)], 1), np.asarray(true, np.float64)
    centre, precision = np.array([prior.offset, prior.slope], np.float64), 1 / np.array(sd) ** 2

    def cost(found: np.ndarray) -> tuple[float, np.ndarray]:
        """Negative log posterior, convex, and its gradient."""
        sums, away = odds @ found, found - centre
        likely = 1 / (1 + np.exp(-sums))
        value = weight * (np.logaddexp(0, sums) - right * sums).sum() + (precision * away**2).sum() / 2
        return float(value), weight * odds.T @ (likely - right) + precision * away

    offset, slope = minimize(cost, centre, jac=True, method="L-BFGS-B", bounds=((None, None), (0, None))).x
    return LogisticMap(float(offset), float(slope))


NEARNESS = LogisticMap(-1.4, 0.4)
"""From the posterior's mass within .05 of a chosen point to the probability that the keypoint is there: mean over
KeypointNet's airplanes, bathtubs and beds of each class's own map (3 shots, 3 draws, block 9 of the saliency ViT-S/14,
every third target)."""
SHARE = 0.1
"""Of each keypoint of a held-out shot as an observation: those of one shape are right or wrong together. When
it was chosen, the expected calibration error of these classes, each by the others' map, was .135, .098 and .138; with
.25, .5 and 1 it was no better, and .27, .13 and .17 without the shots' own word."""
