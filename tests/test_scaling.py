"""Features and distances are brought to a scale that does not depend on the shape or the encoder."""

from __future__ import annotations

import numpy as np
import pytest

from b23d.stages.solvers.scaling import relative_distances, scale_features
from tests.made_templates import line


def test_feature_scales() -> None:
    features = np.random.default_rng(0).normal(3, 2, (500, 8))
    assert np.allclose(scale_features(features, "raw"), features, atol=1e-5)
    assert np.allclose(scale_features(features, "centred").mean(0), 0, atol=1e-5)
    assert np.allclose(np.linalg.norm(scale_features(features, "centred-unit"), axis=1), 1, atol=1e-5)
    standard = scale_features(features, "standardised")
    assert np.allclose(standard.std(0), 1 / np.sqrt(8), atol=1e-5)
    assert (standard**2).sum(1).mean() == pytest.approx(1, abs=1e-4)
    constant = np.ones((5, 3))
    for how in ("centred", "centred-unit", "standardised"):
        assert not scale_features(constant, how).any()  # type: ignore[arg-type]


def test_feature_statistics_come_from_observed_points() -> None:
    features = np.concatenate([np.random.default_rng(0).normal(size=(50, 4)), np.full((50, 4), 100.0)])
    observed = np.arange(100) < 50
    assert np.allclose(scale_features(features, "centred", observed)[:50].mean(0), 0, atol=1e-5)


def test_distance_scales() -> None:
    distances = line(0, 0.5, 2)
    distances[0, 2] = distances[2, 0] = np.inf
    for dtype in (np.float16, np.float64):
        found = relative_distances(distances.astype(dtype))
        assert found.relative[1, 2] == 1 and found.relative[0, 2] == 1 and found.largest == 1.5
        assert found.unreachable is not None and np.argwhere(found.unreachable).tolist() == [[0, 2], [2, 0]]
    nothing = relative_distances(-np.zeros((3, 3), np.float16))
    assert not nothing.relative.any() and nothing.unreachable is None
