"""Per-point features and distances on a shape's candidates."""

from __future__ import annotations

from typing import Annotated

import numpy as np

from b23d.schemas.artifact import ArraySpec, Artifact


class PointFeatures(Artifact):
    """A descriptor for every candidate point; what `backproject`, `reweight` and `describe` give."""

    features: Annotated[np.ndarray, ArraySpec("n channel", "float16")]
    """Mean over the views that see the point (the sum is `features * counts`); filled where `observed` is false."""
    counts: Annotated[np.ndarray, ArraySpec("n", "int32", unit="views that see the point")]
    observed: Annotated[np.ndarray, ArraySpec("n", "bool")]
    """False: no view saw the point. `backproject` leaves zeros there, `reweight` fills along the surface."""
    class_token: Annotated[np.ndarray, ArraySpec("channel", "float32")] | None = None
    """Mean class token over all views, for retrieval."""
    descriptor: str
    """What made it: an encoder's name, hks, wks, shot …"""


class GeodesicDistances(Artifact):
    """All-pairs geodesic distances between candidates."""

    distances: Annotated[np.ndarray, ArraySpec("n n", "float16", unit="unit frame")]
    """Symmetric, zero diagonal, never NaN; +inf between components only where params ask for it."""
    components: Annotated[np.ndarray, ArraySpec("n", "int32")]
    """Connected component of each candidate, before any bridging."""
    method: str
