"""The science: one file a stage. Importing this package declares every stage and data set."""

if __name__ != "b23d.stages":
    raise ImportError(
        f"{__name__}: expected to be imported as b23d.stages, got another name; write `from b23d.stages …`"
    )

from b23d.stages import (
    annotation,
    apply_head,
    backproject,
    calibrate,
    datasets,
    describe,
    detect,
    extract,
    geodesic,
    import_features,
    import_predictions,
    learn,
    normalize,
    optimize,
    orient,
    render,
    reweight,
    score,
    score_parts,
    stand,
    train_head,
    transfer,
)

__all__ = [
    "annotation",
    "apply_head",
    "backproject",
    "calibrate",
    "datasets",
    "describe",
    "detect",
    "extract",
    "geodesic",
    "import_features",
    "import_predictions",
    "learn",
    "normalize",
    "optimize",
    "orient",
    "render",
    "reweight",
    "score",
    "score_parts",
    "stand",
    "train_head",
    "transfer",
]
