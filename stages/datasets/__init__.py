"""Data sets: importing this package declares every `[dataset] kind`."""

from stages.datasets import folder, keypointnet, procedural, shapenetpart
from stages.datasets.procedural import pairs

__all__ = ["folder", "keypointnet", "pairs", "procedural", "shapenetpart"]
