"""The objective all solvers are compared by: L_feature + α L_distance of a choice of candidates.

Wimmer et al., Back to 3D: Few-Shot 3D Keypoint Detection with Back-Projected 2D Features, CVPR 2024, section 3.2, with
the selection matrix restricted to one candidate a keypoint:

    ‖F[c] − F_kp‖ + α ‖(D[c, c] − D_kp) ∘ M‖      (Frobenius norms, not squared)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class Problem:
    """One target and what the shots ask of it.

    features: (n, channel) float32, candidates of the target, scaled as the shots' are.
    distances: (n, n) float32, symmetric, finite, zero diagonal, in the same unit as `target_distances`.
    target_features: (k, channel) float32.
    target_distances: (k, k) float64, symmetric; whatever stands where `mask` is false is not used.
    mask: (k, k) bool, symmetric: pairs that enter the distance term.
    alpha: weight of the distance term.
    """

    features: np.ndarray
    distances: np.ndarray
    target_features: np.ndarray
    target_distances: np.ndarray
    mask: np.ndarray
    alpha: float

    @cached_property
    def feature_costs(self) -> npt.NDArray[np.float64]:
        """Squared feature distance of every keypoint to every candidate, (k, n)."""
        # |a|² − 2ab + |b|² loses digits where features share a large offset, so the offset goes first
        offset = self.features.mean(0, dtype=np.float64)
        candidates = self.features - offset  # (n, channel) float64
        wanted = self.target_features - offset
        squares = (wanted**2).sum(1)[:, None] - 2 * wanted @ candidates.T + (candidates**2).sum(1)[None]
        return np.maximum(squares, 0)

    def among(self, candidates: np.ndarray) -> Problem:
        """The problem of some candidates (m,) alone, as if there were no others."""
        between = self.distances[np.ix_(candidates, candidates)]
        return replace(self, features=self.features[candidates], distances=between)

    @property
    def n(self) -> int:
        return len(self.features)

    @property
    def k(self) -> int:
        return len(self.target_features)


def residuals(problem: Problem, choice: np.ndarray) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Squared residuals of one or many choices.

    choice: (..., k) int. Returns (..., k) squared feature residuals and (..., k, k) squared, masked distance residuals.
    """
    features = problem.feature_costs[np.arange(problem.k), choice]
    between = problem.distances[choice[..., :, None], choice[..., None, :]].astype(np.float64)
    squares = np.where(problem.mask, between - np.where(problem.mask, problem.target_distances, 0), 0) ** 2
    return features, squares


def objective(problem: Problem, choice: np.ndarray) -> npt.NDArray[np.float64]:
    """L_feature + α L_distance of one choice (k,) or of many (..., k); returns (...,) float64."""
    features, squares = residuals(problem, choice)
    return np.sqrt(features.sum(-1)) + problem.alpha * np.sqrt(squares.sum((-1, -2)))


def shares(problem: Problem, choice: np.ndarray) -> npt.NDArray[np.float64]:
    """Each keypoint's share of the objective, (k,); the shares sum to it.

    A norm splits into `r_j² / ‖r‖`; a pair's squared residual stands once in the row of either of its keypoints.
    """
    features, squares = residuals(problem, choice)
    rows = squares.sum(-1)
    return _split(features) + problem.alpha * _split(rows)


def _split(squares: np.ndarray) -> np.ndarray:
    norm = np.sqrt(squares.sum())
    return squares / norm if norm > 0 else np.zeros_like(squares)
