"""One basis for the features of a whole class: colours and similarities that mean the same on each of its shapes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

CHANNELS = 32
POINTS = 512  # of each shape, to fit the basis, unless asked for others
LOW, HIGH = 2.0, 98.0  # percentiles that colours run between


@dataclass(frozen=True)
class Basis:
    """Principal components of a class's features (PCA, fitted on all its shapes together)."""

    mean: np.ndarray
    """(channel,) float64."""
    components: np.ndarray
    """(k, channel) float64 orthonormal rows, largest variance first; k ≤ 32."""
    kept: float
    """Share of the variance that the k components hold."""
    low: np.ndarray
    """(3,) where the first three components' colours begin, and `high` where they end."""
    high: np.ndarray

    def project(self, features: np.ndarray) -> np.ndarray:
        """(n, channel) → (n, k) float32. What is not finite counts as the mean."""
        return np.asarray(
            _finite(features.astype(np.float32) - self.mean.astype(np.float32)) @ self.components.T.astype(np.float32)
        )

    def colors(self, projected: np.ndarray) -> np.ndarray:
        """(n, k) → (n, 3) uint8: the first three components as red, green and blue."""
        first = np.zeros((len(projected), 3), np.float32)
        first[:, : min(3, projected.shape[1])] = projected[:, :3]
        return np.round(np.clip((first - self.low) / (self.high - self.low), 0, 1) * 255).astype(np.uint8)


def fit_basis(shapes: Iterable[np.ndarray], points: int = POINTS) -> Basis:
    """The basis of shapes' features, each (n, channel); about `points` evenly taken rows of each count.

    Raises ValueError where there are none, or where their channels differ.
    """
    sampled = [features[:: max(1, len(features) // points)].astype(np.float64) for features in shapes]
    if not sampled or len({features.shape[1] for features in sampled}) > 1:
        got = sorted({features.shape[1] for features in sampled}) or "none"
        raise ValueError(
            f"features: expected shapes of one class with equal channels, got {got}; use one encoder for all"
        )
    pooled = np.concatenate(sampled)
    pooled = pooled[np.isfinite(pooled).all(axis=1)]
    if not len(pooled):
        raise ValueError("features: expected finite values, got none; check the descriptor")
    mean = pooled.mean(axis=0)
    values, vectors = np.linalg.eigh(np.cov((pooled - mean).T, bias=True).reshape(len(mean), len(mean)))
    components = vectors[:, ::-1][:, :CHANNELS].T
    strongest = np.abs(components).argmax(axis=1)
    components = (
        components * np.sign(components[np.arange(len(components)), strongest])[:, None]
    )  # eigh leaves signs open
    kept = float(values[::-1][:CHANNELS].sum() / (values.sum() or 1.0))
    low, high = np.zeros(3), np.ones(3)
    first = np.percentile((pooled - mean) @ components[:3].T, [LOW, HIGH], axis=0)
    low[: first.shape[1]], high[: first.shape[1]] = first[0], np.maximum(first[1], first[0] + 1e-9)
    return Basis(mean, components, kept, low, high)


def _finite(values: np.ndarray) -> np.ndarray:
    return np.where(np.isfinite(values), values, 0)
