"""Data sets: importing this package declares every `[dataset] kind`."""

from b23d.stages.datasets import folder, given, keypointnet, procedural, shapenetpart
from b23d.stages.datasets.procedural import pairs

__all__ = ["folder", "given", "keypointnet", "pairs", "procedural", "shapenetpart"]
