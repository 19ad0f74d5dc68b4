"""Data sets: importing this package declares every `[dataset] kind`."""

from stages.datasets import folder, keypointnet, procedural

__all__ = ["folder", "keypointnet", "procedural"]
