"""Figures quoted from the paper, for reference beside a run's own.

Wimmer, Wonka and Ovsjanikov, Back to 3D: Few-Shot 3D Keypoint Detection with Back-Projected 2D Features, CVPR 2024: mean of
KeypointNet's airplane, chair and table; 3 shots; DINOv2 ViT-g/14; untextured meshes. Not measured by this program.
"""

from __future__ import annotations

from dataclasses import dataclass

THRESHOLDS = tuple(i / 100 for i in range(11))


@dataclass(frozen=True)
class Quoted:
    name: str
    thresholds: tuple[float, ...]
    iou: tuple[float, ...]
    note: str = ""

    @property
    def auc(self) -> float | None:
        """Mean over all thresholds; None where only some are known."""
        return sum(self.iou) / len(self.iou) if len(self.iou) == len(THRESHOLDS) else None


QUOTED = (
    Quoted("B2-3D", THRESHOLDS, (0.12, 0.20, 0.36, 0.46, 0.53, 0.58, 0.62, 0.64, 0.67, 0.69, 0.71)),
    Quoted("Hungarian", THRESHOLDS, (0.08, 0.13, 0.23, 0.31, 0.37, 0.42, 0.47, 0.50, 0.53, 0.55, 0.58)),
    Quoted("FSKD", (0.10,), (0.555,), "reaches at .10 what B2-3D reaches at about .045"),
)
SOURCE = "quoted from the paper: mean of airplane, chair, table; 3 shots; DINOv2 ViT-g; meshes"
