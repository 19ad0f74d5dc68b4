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
        radius, apart = scale * options["iss_salient_radius"], scale * options["iss_non_max_radius"]
        least = int(options["iss_min_neighbors"])
        response = iss(points, radius, options["iss_gamma_21"], options["iss_gamma_32"], least)
        chosen = strongest(points, response, apart)
    elif method == "harris":
        response = harris3d(points, scale * options["harris_radius"], options["harris_k"])
        most = int(np.ceil(options["harris_fraction"] * len(points)))
        chosen = strongest(points, response, scale * options["harris_separation"])[:most]
    else:
        finest = scale * options["sift_min_scale"]
        octaves, steps = int(options["sift_octaves"]), int(options["sift_scales_per_octave"])
        response = sift3d(points, finest, octaves, steps, options["sift_min_contrast"])
        chosen = strongest(points, response, finest)  # one point may be an extremum at several scales, next to another
    return chosen, response[chosen]
