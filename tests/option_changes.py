"""For every option of every stage: settings beside which it counts, and a value to change it to."""

from __future__ import annotations

from typing import Any

FIBONACCI, PERCEPTRON = {"layout": "fibonacci", "fibonacci.views": 5}, {"detector": "hidden", "hidden.width": 4}
SMALL = {"rings.count": 1, "resolution": 32}
WATERTIGHT = {"max_nonfinite": 0.5, "watertight": True, "watertight_resolution": 12, "candidates": "fps", "count": 20}
SPECTRAL = {"hks.eigenpairs": 20, "wks.eigenpairs": 20, "wks.energies": 8}
TINY = {"encoder": "test/tiny", "precision": "fp32", "input_size": 112}
SHORT = {"steps": 20, "absent": "never"}
ADAM = {"beta": ({}, 5.0), "steps": ({}, 12), "learning_rate": ({}, 1.0)}

DISCRETE: dict[str, tuple[dict[str, Any], Any]] = {
    "one_to_one": ({"alpha": 0.0}, True),
    "starts": ({"alpha": 30.0}, 2),
    "passes": ({"alpha": 1000.0, "discrete.starts": 8}, 1),
    "seed": ({"alpha": 30.0, "discrete.starts": 4, "discrete.passes": 1}, 4),
    "softmax_start": ({"alpha": 30.0, "discrete.starts": 2, "discrete.passes": 1, "discrete.softmax.steps": 40}, True),
}


def under(table: str, options: dict[str, tuple[dict[str, Any], Any]], **beside: Any) -> dict[str, Any]:
    return {
        f"{table}.{name}": ({**beside, **{f"{table}.{key}": value for key, value in settings.items()}}, other)
        for name, (settings, other) in options.items()
    }


CASES: dict[str, dict[str, tuple[dict[str, Any], Any]]] = {
    "annotation": {"warn": ({}, 0.09), "refuse": ({}, 0.03), "together": ({}, 3.0)},
    "apply_head": {"separation": ({}, 0.6)},
    "backproject": {
        "visibility": ({}, "face"),
        "point.depth_tolerance": ({}, 0.3),
        "sample": ({}, "nearest"),
    },
    "calibrate": {
        "method": ({}, "iss"),
        "count": ({}, 3),
        **under(
            "iss",
            {
                "calibrate": ({"salient_radius": 0.2, "non_max_radius": 0.1, "scales": (2.0,)}, False),
                "scales": ({"salient_radius": 0.2, "non_max_radius": 0.1}, (3.0,)),
                "threshold": ({"salient_radius": 0.2, "non_max_radius": 0.1}, 0.4),
                "salient_radius": ({"calibrate": False, "salient_radius": 0.2, "non_max_radius": 0.1}, 0.3),
                "non_max_radius": ({"calibrate": False, "salient_radius": 0.2, "non_max_radius": 0.1}, 0.3),
                "gamma_21": ({"calibrate": False, "salient_radius": 0.2, "non_max_radius": 0.1}, 0.5),
                "gamma_32": ({"calibrate": False, "salient_radius": 0.2, "non_max_radius": 0.1}, 0.3),
                "min_neighbors": ({"calibrate": False, "salient_radius": 0.2, "non_max_radius": 0.1}, 40),
            },
            method="iss",
        ),
        **under(
            "harris",
            {
                "calibrate": ({"radius": 0.3, "scales": (2.0,)}, False),
                "scales": ({"radius": 0.3}, (3.0,)),
                "threshold": ({"radius": 0.3}, 0.4),
                "radius": ({"calibrate": False, "radius": 0.3}, 0.2),
                "k": ({"calibrate": False, "radius": 0.3}, 0.24),
                "separation": ({"calibrate": False, "radius": 0.3}, 0.5),
                "fraction": ({"calibrate": False, "radius": 0.3}, 0.005),
            },
            method="harris",
        ),
        **under(
            "sift",
            {
                "calibrate": ({"min_scale": 0.05, "scales": (2.0,)}, False),
                "scales": ({"min_scale": 0.05}, (3.0,)),
                "threshold": ({"min_scale": 0.08}, 0.4),
                "min_scale": ({"calibrate": False}, 0.1),
                "scales_per_octave": ({"calibrate": False, "min_scale": 0.05}, 1),
                "min_contrast": ({"calibrate": False, "min_scale": 0.05}, 0.02),
            },
            method="sift",
        ),
        "sift.octaves": (
            {"method": "sift", "count": 400, "sift.octaves": 1}
            | {"sift.calibrate": False, "sift.min_scale": 0.07, "sift.min_contrast": 0.0},
            3,
        ),
    },
    "describe": {
        "descriptor": (SPECTRAL, "wks"),
        "surface": (SPECTRAL, "cloud"),
        "hks.eigenpairs": (SPECTRAL, 10),
        "hks.times": (SPECTRAL, 4),
        "hks.shortest": (SPECTRAL, 0.05),
        "hks.longest": (SPECTRAL, 2.0),
        **under("wks", {"eigenpairs": ({}, 10), "energies": ({}, 5), "width": ({}, 2.0)}, **SPECTRAL, descriptor="wks"),
        "shot.radius": ({"descriptor": "shot"}, 0.4),
    },
    "detect": {},
    "extract": {
        "encoder": (TINY | {"input_size": None}, "sam-vit-base"),
        "blocks": (TINY, (0,)),
        "layernorm": (TINY, False),
        "input_size": (TINY, 28),
        "class_token": (TINY, False),
        "tokens": (TINY, "all"),
        "foreground.background": (TINY, 0),
        "foreground.seed": (TINY, 1),
        "precision": (TINY, "bf16"),
    },
    "geodesic": {
        "method": ({}, "euclidean"),
        **under("graph", {"neighbors": ({}, 4), "disconnected": ({"neighbors": 5}, "max"), "shortcuts": ({}, "cut")}),
        **under("heat", {"neighbors": ({}, 5), "disconnected": ({"neighbors": 5}, "max")}, method="heat"),
    },
    "import_features": {"format": ({}, "d3feat"), "frame": ({}, "unit"), "reach": ({}, 1.0)},
    "import_predictions": {
        "format": ({}, "d3feat"),
        "frame": ({}, "unit"),
        "min_score": ({}, 0.5),
        "nms_radius": ({}, 0.4),
        "keep": ({}, 3),
        **under(
            "sift3d_csv",
            {"spacing": ({"spacing": 0.25}, 0.3), "origin": ({"spacing": 0.25}, (0.1, 0.0, 0.1))},
            format="sift3d-csv",
        ),
    },
    "learn": {
        "components": ({}, 2),
        "ridge": ({}, 30.0),
        "radii": ({}, (0.3,)),
        "gate_prior": ({"same_frame": 180.0}, 1000.0),
        "same_frame": ({}, 180.0),
        **under(
            "deformation",
            {
                "affine_sd": ({}, 3.0),
                "quadratic_sd": ({}, 3.0),
                "smooth_sd": ({}, 3.0),
                "smooth_length": ({}, 0.01),
                "independent_sd": ({}, 0.01),
                "worth": ({}, 1000.0),
            },
        ),
        **under(
            "template",
            {
                "features": ({}, "raw"),
                "source_features": ({"source_sigma": 0.5}, "keypoints"),
                "source_sigma": ({"source_features": "keypoints"}, 0.5),
                "combine": ({}, "sum_distances"),
                "distances": ({}, "unit-frame"),
                "mask": ({}, "positive"),
            },
        ),
    },
    "normalize": {
        "candidates": ({"max_nonfinite": 0.5, "count": 20}, "fps"),
        "count": ({"max_nonfinite": 0.5, "candidates": "fps", "count": 20}, 30),
        "cloud_limit": ({"max_nonfinite": 0.5, "count": 20}, 10),
        "seed": ({"max_nonfinite": 0.5, "candidates": "fps", "count": 20}, 1),
        "max_nonfinite": ({}, 0.5),
        "turn": ({"max_nonfinite": 0.5}, 30.0),
        "stray": ({"count": 20}, "keep"),
        "watertight": (WATERTIGHT | {"watertight": False}, True),
        "watertight_resolution": (WATERTIGHT, 16),
        "colors": ({"max_nonfinite": 0.5}, False),
    },
    "optimize": {
        "method": ({}, "nearest"),
        "alpha": ({}, 3.0),
        "retrieval": ({}, True),
        "presence": ({}, "majority"),
        **under(
            "posterior",
            {
                "keypoint_weight": ({}, 15.0),
                "identity_weight": ({}, 8.0),
                "shift_sd": ({}, 0.01),
                "shift_worth": ({"shift_sd": 0.01}, 0.01),
                "plain_after": ({"keypoint_weight": 15.0}, 0.01),
                "distance_weight": ({}, 50.0),
                "distance_sd": ({}, 0.005),
                "turns": ({}, 2),
                "surface_weight": ({}, 0.0),
                "contrast_weight": ({}, 0.0),
                "turn_concentration": ({"temper": 1e6}, 2000.0),
                "sides_sd": ({"temper": 1e6}, 1000.0),
                "temper": ({"sides_sd": 0.001}, 1e6),
                "iterations": ({}, 1),
                "hit_radius": (
                    {"keypoint_weight": 0.0, "identity_weight": 0.0, "distance_weight": 0.0, "shift_sd": 10.0},
                    0.5,  # where looks tell little, so that points near each other are as likely
                ),
                "present": ({}, 1.0),
            },
        ),
        **{
            f"discrete.{name}": (settings | {"method": "discrete"}, other)
            for name, (settings, other) in DISCRETE.items()
        },
        **under(
            "discrete.softmax",
            {"beta": ({}, 50.0), "steps": ({"steps": 2}, 40), "learning_rate": ({}, 1.0)},
            method="discrete",
            **{
                "alpha": 30.0,
                "discrete.starts": 2,
                "discrete.passes": 1,
                "discrete.softmax_start": True,
                "discrete.softmax.steps": 40,
            },
        ),
        **under(
            "softmax",
            ADAM | {"seed": ({}, 1), "one_to_one": ({"steps": 1}, True)},
            method="softmax",
            **{"softmax.steps": 40},
        ),
        "hungarian.assignment": ({"method": "hungarian"}, "sorted"),
    },
    "orient": {"count": ({}, 128), "turns": ({}, 5), "weight": ({}, 1.0)},
    "render": {
        "layout": (SMALL | {"fibonacci.views": 6}, "fibonacci"),
        "rings.count": (SMALL, 2),
        "fibonacci.views": (FIBONACCI | {"resolution": 32}, 7),
        "azimuth_offset": (SMALL, 10.0),
        "resolution": (SMALL, 40),
        "field_of_view": (SMALL, 40.0),
        "distance": (SMALL, 3.0),
        "distance_factor": (SMALL, 1.5),
        "margin": (SMALL, 0.3),
        "renderer": (SMALL, "pyrender"),
        "shading": (SMALL, "smooth"),
        "albedo": (SMALL, 0.3),
        "ambient": (SMALL, 0.9),
        "texture": (SMALL, True),
        "disc_radius": (SMALL, 0.5),
        "disc_neighbours": (SMALL, 4),
    },
    "reweight": {
        "sigma": ({}, 0.3),
        "normalised": ({"sigma": 0.1}, False),
        "weight": ({"sigma": 0.1}, "views"),
        "fill": ({"sigma": 1e-3}, "zeros"),
        "batches": ({"sigma": 0.1}, 3),
    },
    "score": {
        "thresholds": ({}, (0.04,)),
        "inside": ({"thresholds": (0.0,)}, "<"),
        "iou": ({}, "one-to-one"),
        "units": ({}, "unit"),
        "neighbors": ({}, 1),
    },
    "score_parts": {"absent": ({}, "skip")},
    "stand": {"count": ({}, 64)},
    "train_head": {
        "features": (SHORT, "raw"),
        "context": (SHORT, 0.0),
        "sigma": (SHORT, 0.3),
        "detector": (SHORT, "hidden"),
        **under("hidden", {"width": ({}, 9), "seed": ({}, 1)}, **SHORT, **PERCEPTRON),
        "components": (SHORT, 2),
        "steps": (SHORT, 90),
        "learning_rate": (SHORT, 0.2),
        "weight_decay": (SHORT, 40.0),
        "absent": ({"steps": 20}, "never"),
    },
    "transfer": {
        "k": ({}, 1),
        "weighting": ({}, "uniform"),
        "features": ({}, "raw"),
    },
}
"""Stage → option → settings beside which it counts, and a value other than the one it has there."""
