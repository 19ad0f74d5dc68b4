"""Sums over balls around every candidate, dense in blocks of rows: for a few thousand points faster than a tree."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

ROWS = 512
"""Rows of the (n, n) matrix of distances that are held at a time."""


def blocks(points: np.ndarray) -> Iterator[tuple[slice, npt.NDArray[np.float64]]]:
    """Squared distances (rows, n) from a block of points to all, block by block; points (n, 3) float64."""
    squares = np.einsum("ni,ni->n", points, points)
    for start in range(0, len(points), ROWS):
        rows = slice(start, min(start + ROWS, len(points)))
        squared = points[rows] @ points.T
        squared *= -2
        squared += squares
        squared += squares[rows, None]
        yield rows, squared


def ball_sums(points: np.ndarray, radius: float, columns: np.ndarray) -> npt.NDArray[np.float64]:
    """Σ columns[j] over all j within `radius` of i, itself included: (n, 3), (n, c) → (n, c)."""
    sums = np.empty_like(columns, dtype=np.float64)
    for rows, squared in blocks(points):
        sums[rows] = (squared <= radius * radius).astype(np.float64) @ columns
    return sums


def scatter_matrices(
    points: np.ndarray, radius: float, weights: np.ndarray
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Weighted Σ w (q - p)(q - p)ᵀ and Σ w (q - p) over the balls: (n, 3, 3) about the point itself, and (n, 3), both
    over Σ w."""
    outer = np.einsum("ni,nj->nij", points, points).reshape(-1, 9)
    columns = np.concatenate([np.ones((len(points), 1)), points, outer], axis=1) * weights[:, None]
    sums = ball_sums(points, radius, columns)
    total = np.maximum(sums[:, :1], np.finfo(np.float64).tiny)
    mean, square = sums[:, 1:4] / total, (sums[:, 4:] / total).reshape(-1, 3, 3)
    cross = np.einsum("ni,nj->nij", mean, points)
    about = square - cross - cross.transpose(0, 2, 1) + np.einsum("ni,nj->nij", points, points)
    return about, mean - points


def strongest(points: np.ndarray, response: np.ndarray, radius: float) -> npt.NDArray[np.int64]:
    """Non-maximum suppression: the points whose response nothing within `radius` exceeds, strongest first.

    Only finite responses above 0 take part. Of equal ones the first in the cloud's order counts as the stronger.
    """
    response = np.where(np.isfinite(response), response, 0)
    order = np.argsort(-response, kind="stable")
    order = order[response[order] > 0]
    among = points[order]
    place = np.arange(len(order))
    kept = np.zeros(len(order), bool)
    for rows, squared in blocks(among):
        kept[rows] = (squared <= radius * radius).argmax(axis=1) == place[
            rows
        ]  # the first within reach is the point itself
    return order[kept].astype(np.int64)
