"""The science: one file a stage. Importing this package declares every stage and data set."""

from stages import backproject, datasets, describe, extract, geodesic, normalize, optimize, render, reweight, score

__all__ = ["backproject", "datasets", "describe", "extract", "geodesic", "normalize", "optimize", "render", "reweight", "score"]
