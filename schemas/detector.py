"""Detector: a geometric keypoint detector, its scale and count chosen on the shots of one draw."""

from __future__ import annotations

from typing import Literal

from b23d.schemas.artifact import Artifact


class Detector(Artifact):
    """What `calibrate` gives and `detect` applies: a method and all it needs to know."""

    method: Literal["farthest", "iss", "harris", "sift"]
    scale: float
    """What the method's lengths are multiplied by; 1 where it was not calibrated."""
    count: int
    """How many points at most."""
    options: dict[str, float]
    """The method's own constants, by their names among `calibrate`'s params; lengths in the unit frame, before
    `scale`."""
    iou: float | None = None
    """On the shots it was calibrated on, so higher than on targets; None where it was not calibrated."""
    shots: list[str]
    """Indices of the shots, as text."""
