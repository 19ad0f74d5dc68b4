"""The discrete solver is never worse than the paper's optimiser: real and made shapes, real (axiomatic) descriptors,
both scales.

`tests/benchmarks/bench_objectives.py` says the same of all targets of a run.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from b23d.pipeline.dataset import Leaf, Shape
from b23d.stages.datasets.keypointnet import KeypointNet
from b23d.stages.datasets.procedural import Procedural
from b23d.stages.describe import DescribeParams, describe
from b23d.stages.geodesic import GeodesicParams, geodesic
from b23d.stages.normalize import NormalizeParams, normalize
from b23d.stages.solvers.discrete import discrete
from b23d.stages.solvers.learn_options import LearnParams, Templates
from b23d.stages.solvers.objective import Problem, objective
from b23d.stages.solvers.observing import observe
from b23d.stages.solvers.posing import pose
from b23d.stages.solvers.retrieval import weights_of
from b23d.stages.solvers.scaling import relative_distances, scale_features
from b23d.stages.solvers.shots import labelled
from b23d.stages.solvers.template import template_of
from tests.shared_data import shared

SCALES = [(Templates(), 0.25), (Templates(features="standardised"), 4.0)]
"""What a template is made of, and the weight of its distances."""


def loaded(leaf: Leaf) -> Any:
    return leaf.load({name: path.read_bytes() for name, path in leaf.files.items()}, {**leaf.values, **leaf.context})


def problems(shapes: list[Shape], shots: int) -> Iterator[tuple[str, Problem]]:
    """Every shape but the first `shots` as a target of these, 192 candidates each, described by SHOT, in both
    scales."""
    made = []
    for shape in shapes:
        clean = normalize(loaded(shape.leaves["source"]), NormalizeParams(candidates="fps", count=192))
        described = describe(clean, DescribeParams(descriptor="shot"))
        made.append((clean, described, geodesic(clean, GeodesicParams()), loaded(shape.leaves["keypoints"])))
    taught = labelled(*(list(column) for column in zip(*made[:shots], strict=True)))
    for scale, alpha in SCALES:
        model = observe(taught, LearnParams(template=scale))
        for shape, (_, looks, distances, _) in zip(shapes[shots:], made[shots:], strict=True):
            template = template_of(model, weights_of(model, looks, False))
            features = scale_features(looks.features, model.feature_scale, looks.observed)
            yield shape.name, pose(features, relative_distances(distances.distances), model, template, alpha)


def check(shapes: list[Shape], shots: int = 3, steps: int = 600) -> None:
    from b23d.stages.solvers.softmax import softmax

    count = 0
    for name, problem in problems(shapes, shots):
        reached = objective(problem, discrete(problem)), objective(problem, softmax(problem, steps=steps))
        assert reached[0] <= reached[1] * (1 + 1e-9), f"{name}, alpha {problem.alpha}: {reached}"
        count += 1
    assert count == len(SCALES) * (len(shapes) - shots) > 0


@pytest.mark.parametrize("category", ["airplane", "bathtub", "bed"])
def test_discrete_is_never_worse_on_keypointnet(category: str) -> None:
    check(KeypointNet(root=shared("keypointnet"), classes=[category]).shapes()[:5])


@pytest.mark.parametrize("category", ["chair", "mug"])
def test_discrete_is_never_worse_on_made_shapes(category: str) -> None:
    check(Procedural(kind="procedural", classes=[category], count=5).shapes())  # type: ignore[list-item]
