"""What the report's page packs: arrays and distances come back as they were, or as near as promised."""

from __future__ import annotations

import base64
import zlib

import numpy as np
import pytest

from b23d.stages.workbench.pictures.packing import as_text, curve_order, pack
from b23d.stages.workbench.report.distances import LANDMARKS, among, encode, landmarks, quantise


def test_packed_arrays_unpack_to_the_same_bytes() -> None:
    for array in (np.arange(12, dtype=np.uint16).reshape(3, 4), np.array([True, False]), np.zeros((0, 3), np.int32)):
        packed = pack(array)
        back = np.frombuffer(zlib.decompress(base64.b64decode(packed["data"])), packed["dtype"]).reshape(
            packed["shape"]
        )
        np.testing.assert_array_equal(back, array)
    with pytest.raises(TypeError, match="got float64"):
        pack(np.zeros(3))


@pytest.mark.parametrize("size", [0, 1, 6, 7, 8, 4096])
def test_bytes_as_text_come_back_from_a_page(size: int) -> None:
    data = np.random.default_rng(size).integers(0, 256, size, np.uint8).tobytes()
    text = as_text(data)
    assert not set(text) & {"\0", "\r", "<"} and len(text.encode()) <= 8 + 1.19 * size
    bits = np.unpackbits(np.array([[ord(c) & 127] for c in text], np.uint8).reshape(-1, 1), axis=1)[:, 1:].reshape(-1)
    assert np.packbits(bits[: 8 * size]).tobytes() == data


def decode(residuals: np.ndarray, n: int) -> np.ndarray:
    """The inverse of `encode`, as the page does it."""
    levels = np.zeros((n, n), np.uint8)
    at = 0
    for i in range(1, n):
        row = residuals[at : at + i].astype(np.int64)
        at += i
        levels[i, :i] = np.mod(np.cumsum(row + np.diff(levels[i - 1, :i].astype(np.int64), prepend=0)), 256)
    return np.maximum(levels, levels.T)


@pytest.mark.parametrize("n", [1, 2, 60])
def test_distances_survive_packing_to_eight_bits(n: int) -> None:
    points = np.random.default_rng(n).random((n, 3))
    distances = np.linalg.norm(points[:, None] - points[None], axis=2).astype(np.float16)
    levels, largest = quantise(distances)
    assert np.abs(levels * (largest / 255) - distances).max() <= largest / 255
    order = curve_order(points)
    assert sorted(order) == list(range(n))
    ordered = levels[np.ix_(order, order)]
    np.testing.assert_array_equal(decode(encode(ordered), n), ordered)


@pytest.mark.parametrize("n", [1, 2, 40, LANDMARKS + 300])
def test_landmarks_tell_every_distance_as_well_as_they_lie_near(n: int) -> None:
    """By the triangle inequality: no farther off than the landmarks are from both points."""
    points = np.random.default_rng(n).random((n, 3))
    distances = np.linalg.norm(points[:, None] - points[None], axis=2)
    chosen = landmarks(points)
    near, weights = among(distances[:, chosen])
    assert (weights.astype(int).sum(axis=1) == 255).all() and len(chosen) == min(n, LANDMARKS)
    share = np.zeros((n, len(chosen)))
    np.add.at(share, (np.arange(n)[:, None], near), weights / 255)
    off = np.abs(share @ distances[np.ix_(chosen, chosen)] @ share.T - distances)
    reach = np.where(weights > 0, np.take_along_axis(distances[:, chosen], near.astype(int), axis=1), 0).max(axis=1)
    assert (off <= reach[:, None] + reach[None] + 1e-9).all()
    if n <= LANDMARKS:
        assert off.max() < 1e-6


def test_landmarks_that_no_path_reaches_still_have_weights() -> None:
    _, weights = among(np.full((3, 5), np.inf))
    assert (weights.astype(int).sum(axis=1) == 255).all()


def test_pairs_without_a_path_count_as_the_largest_distance() -> None:
    levels, largest = quantise(np.array([[0, 2, np.inf], [2, 0, np.inf], [np.inf, np.inf, 0]], np.float16))
    assert largest == 2 and levels[0, 2] == 255
