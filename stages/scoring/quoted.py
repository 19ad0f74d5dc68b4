"""Figures quoted from the paper, for reference columns: nothing here was measured by this program.

Wimmer, Wonka and Ovsjanikov, Back to 3D: Few-Shot 3D Keypoint Detection with Back-Projected 2D Features, CVPR 2024. Its
other curves (FSKD, FPS, UKPGAN, D3Feat, USIP, ISS, SIFT-3D, HARRIS-3D, HKS, WKS, SHOT, CLIP, SAM, EfficientNet, α, β)
are drawn only: the source reads them from files that were not published with it, so of those there is what the text
says, and no figure is read off a plot.
"""

from __future__ import annotations

from dataclasses import dataclass

SOURCE = "quoted from Wimmer et al., CVPR 2024"
THRESHOLDS = tuple(i / 100 for i in range(11))


@dataclass(frozen=True)
class QuotedCurve:
    """KeypointNet's label-agnostic IoU in 0 … 1 at THRESHOLDS (data set's units), as printed: two digits."""

    system: str
    iou: tuple[float, ...]
    table: str
    setting: str = "mean of airplane, chair, table; 3 shots; DINOv2 ViT-g/14; meshes without texture"
    quoted: str = SOURCE

    @property
    def auc(self) -> float:
        """Mean over the thresholds, from the printed digits."""
        return sum(self.iou) / len(self.iou)

    @property
    def source(self) -> str:
        """Whence, and in which setting, in one line."""
        return f"{self.quoted}: {self.setting}"


@dataclass(frozen=True)
class QuotedStatement:
    """What the text says of a system that has no printed curve."""

    systems: tuple[str, ...]
    says: str
    quoted: str = SOURCE


@dataclass(frozen=True)
class QuotedParts:
    """Part-label transfer on ShapeNetPart: IoU in percent by class (in PART_CLASSES' order), and their mean as
    printed."""

    system: str
    iou: tuple[float, ...]
    mean: float
    quoted: str = f"{SOURCE}, Tab. label-transfer-results"

    def of(self, category: str) -> float | None:
        """Of one class; None where the paper has none of that name."""
        return dict(zip(PART_CLASSES, self.iou, strict=True)).get(category)


B2_3D = QuotedCurve("B2-3D", (0.12, 0.20, 0.36, 0.46, 0.53, 0.58, 0.62, 0.64, 0.67, 0.69, 0.71), "hungarian-baseline")
HUNGARIAN = QuotedCurve(
    "Hungarian", (0.08, 0.13, 0.23, 0.31, 0.37, 0.42, 0.47, 0.50, 0.53, 0.55, 0.58), "hungarian-baseline"
)
CURVES = (B2_3D, HUNGARIAN)

STATEMENTS = (
    QuotedStatement(
        ("FSKD",),
        "B2-3D reaches at about .045 the IoU that FSKD has at .10; mean relative gain 93 %, over 200 % at .02",
    ),
    QuotedStatement(("Hungarian",), "B2-3D improves over it by 37 % on average"),
    QuotedStatement(
        ("FPS",),
        "farthest points from the largest mean geodesic distance, as many as the shots have on average: above many",
    ),
    QuotedStatement(("HKS", "WKS", "SHOT"), "HKS is the best of the three, and only as good as FPS"),
    QuotedStatement(("CLIP", "EfficientNet"), "below DINO; both above FSKD, EfficientNet above CLIP"),
    QuotedStatement(("SAM",), "below EfficientNet, as CLIP is"),
    QuotedStatement(("DINOv2 ViT-S",), "almost equal to ViT-g"),
    QuotedStatement(("texture",), "slightly worse than without"),
    QuotedStatement(("retrieval",), "not effective with 3 shots"),
    QuotedStatement(("1 shot",), "lower and with a higher variance, yet above FSKD with 3"),
    QuotedStatement(("nearest neighbour",), "lower: it collapses on symmetric shapes"),
)

PART_CLASSES = (
    "airplane", "bag", "cap", "chair", "earphone", "guitar", "knife", "lamp", "laptop", "motorbike", "mug", "pistol",
    "rocket",
    "skateboard", "table",
)  # fmt: skip
PARTS = (
    QuotedParts(
        "IDC", (60.1, 56.2, 59.7, 72.2, 45.3, 81.5, 66.4, 42.6, 88.5, 40.5, 87.5, 66.4, 37.2, 50.7, 70.4), 61.7
    ),
    QuotedParts(
        "CPAE", (61.3, 59.3, 61.6, 72.6, 55.5, 78.9, 71.3, 53.2, 89.9, 55.4, 86.5, 66.2, 40.2, 61.8, 72.5), 65.8
    ),
    QuotedParts(
        "NCP", (63.7, 66.7, 68.7, 80.2, 59.0, 78.8, 72.5, 61.9, 91.4, 57.2, 89.5, 61.4, 44.2, 63.6, 79.2), 69.2
    ),
    QuotedParts(
        "DINO", (64.8, 75.1, 67.5, 72.1, 77.3, 83.6, 71.7, 57.9, 89.6, 64.3, 91.0, 73.2, 47.9, 65.8, 63.1), 71.0
    ),
    QuotedParts(
        "CLIP", (59.4, 66.9, 73.4, 62.9, 70.9, 76.4, 68.1, 52.8, 84.1, 57.3, 86.4, 66.1, 43.4, 63.6, 62.2), 66.3
    ),
    QuotedParts(
        "EfficientNet", (56.6, 69.5, 63.2, 64.4, 72.1, 81.6, 70.8, 50.6, 88.5, 59.5, 82.6, 63.5, 44.9, 60.2, 64.2), 66.1
    ),
    QuotedParts(
        "SAM", (36.8, 65.3, 57.1, 59.7, 56.6, 79.0, 72.8, 51.8, 75.8, 43.6, 49.0, 56.6, 32.4, 46.8, 53.8), 55.8
    ),
)


def statements_of(system: str) -> list[QuotedStatement]:
    """What the paper says of a system: of "SAM ViT-H" what it says of SAM, but nothing of "SAM-like"."""
    return [said for said in STATEMENTS if any(_is(system, known) for known in said.systems)]


def _is(system: str, known: str) -> bool:
    after = system[len(known) :][:1]
    return system.casefold().startswith(known.casefold()) and not (after.isalnum() or after == "-")
