"""The science: one file a stage. Importing this package declares every stage and data set."""

from stages import (
    apply_head,
    backproject,
    datasets,
    describe,
    detect,
    external,
    extract,
    geodesic,
    normalize,
    optimize,
    render,
    reweight,
    score,
    score_parts,
    train_head,
    transfer,
)

__all__ = [
    "apply_head",
    "backproject",
    "datasets",
    "describe",
    "detect",
    "external",
    "extract",
    "geodesic",
    "normalize",
    "optimize",
    "render",
    "reweight",
    "score",
    "score_parts",
    "train_head",
    "transfer",
]
