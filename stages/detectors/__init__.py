"""Detectors of points that stand out by geometry alone: they know no names."""
