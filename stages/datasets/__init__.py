"""Data sets: importing this package declares every `[dataset] kind`."""

from stages.datasets import folder, keypointnet, procedural, shapenetpart

__all__ = ["folder", "keypointnet", "procedural", "shapenetpart"]
