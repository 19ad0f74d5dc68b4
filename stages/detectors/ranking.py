"""The points that a detector finds on one shape, strongest first."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from b23d.stages.detectors.harris3d import harris3d
from b23d.stages.detectors.iss import iss
from b23d.stages.detectors.neighbourhoods import strongest
from b23d.stages.detectors.sift3d import sift3d


def ranked(
    points: np.ndarray, method: str, options: Mapping[str, float], scale: float
) -> tuple[np.ndarray, np.ndarray]:
    """Indices (m,) of a method's points among (n, 3), all its lengths multiplied by `scale`, and their responses (m,).

    method: "iss", "harris" or "sift"; options: its constants, as `Detector.options` has them.
    """
    if method == "iss":
        radius, separation = scale * options["salient_radius"], scale * options["non_max_radius"]
        least = int(options["min_neighbors"])
        response = iss(points, radius, options["gamma_21"], options["gamma_32"], least)
        chosen = strongest(points, response, separation)
    elif method == "harris":
        response = harris3d(points, scale * options["radius"], options["k"])
        most = int(np.ceil(options["fraction"] * len(points)))
        chosen = strongest(points, response, scale * options["separation"])[:most]
    else:
        finest = scale * options["min_scale"]
        octaves, steps = int(options["octaves"]), int(options["scales_per_octave"])
        response = sift3d(points, finest, octaves, steps, options["min_contrast"])
        chosen = strongest(points, response, finest)  # one point may be an extremum at several scales, next to another
    return chosen, response[chosen]
