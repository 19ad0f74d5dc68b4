"""The problems that the targets of a run pose to its solvers, from artifacts that its store already has."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np

from b23d.pipeline.planning.nodes import LeafNode, Node, State
from b23d.pipeline.run import Run
from b23d.schemas.artifact import Artifact
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.predictions import Prediction
from b23d.schemas.scores import ShapeScore
from b23d.schemas.shape import NormalizedShape
from b23d.stages.optimize import OptimizeParams
from b23d.stages.score import ScoreParams, score
from b23d.stages.solvers.objective import Problem
from b23d.stages.solvers.posing import pose
from b23d.stages.solvers.retrieval import weights_of
from b23d.stages.solvers.scaling import relative_distances, scale_features
from b23d.stages.solvers.template import Template, template_of


@dataclass(frozen=True)
class Posed:
    """One target under one draw of shots."""

    category: str
    shape: str
    draw: int
    template: Template
    problem: Problem
    normalize: NormalizedShape = field(repr=False)
    keypoints: Keypoints | None = field(repr=False)
    """The target's own, where it is annotated."""
    shot_keypoints: list[Keypoints] = field(repr=False)

    def score(self, choice: np.ndarray) -> ShapeScore | None:
        """Every id predicted at `choice` (k,); None where the target is not annotated."""
        if self.keypoints is None:
            return None
        k = len(choice)
        prediction = Prediction(
            ids=self.template.ids,
            points=choice.astype(np.int32),
            positions=self.normalize.points[choice],
            present=np.ones(k, bool),
            costs=np.zeros(k, np.float32),
            objective=0.0,
            method="benchmark",
        )
        return score(self.normalize, prediction, self.keypoints, self.shot_keypoints, ScoreParams())


def posed(run: Run, per_class: int | None = None) -> Iterator[Posed]:
    """Every target of every draw whose inputs are stored, a class at a time; at most `per_class` shapes of each
    class."""
    params = run.config.params["optimize"]
    assert isinstance(params, OptimizeParams)
    categories = {shape.name: shape.category for shape in run.shapes}
    leaves = {shape.name: shape.leaves.get("keypoints") for shape in run.shapes}

    @lru_cache(maxsize=96)
    def stored(stage: str, address: str) -> Artifact:
        return run.store.read(stage, address, run.config.stages[stage].gives)

    def given(item: Any) -> Any:
        if isinstance(item, list):
            return [given(one) for one in item]
        if isinstance(item, LeafNode):
            return loaded(item.leaf)
        return stored(item.stage, item.address)

    plan = run.plan()
    nodes: dict[str, list[tuple[int, Node]]] = {}
    for (stage, shape, draw), node in plan.by_shape.items():
        if stage == "optimize" and all(
            above.state is State.CACHED for above in node.upstream() if isinstance(above, Node)
        ):
            nodes.setdefault(shape, []).append((draw or 0, node))
    taken: dict[str, int] = {}
    for shape in sorted(nodes, key=lambda name: (categories[name], name)):
        category = categories[shape]
        if per_class is not None and taken.get(category, 0) >= per_class:
            continue
        taken[category] = taken.get(category, 0) + 1
        for draw, node in sorted(nodes[shape], key=lambda pair: pair[0]):
            inputs = {name: given(item) for name, item in node.inputs.items()}
            own, learned = leaves[shape], node.inputs["learn"]
            assert isinstance(learned, Node)
            learn, reweight = inputs["learn"], inputs["reweight"]
            template = template_of(learn, weights_of(learn, reweight, params.retrieval))
            features = scale_features(reweight.features, learn.feature_scale, reweight.observed)
            problem = pose(features, relative_distances(inputs["geodesic"].distances), learn, template, params.alpha)
            yield Posed(
                category,
                shape,
                draw,
                template,
                problem,
                inputs["normalize"],
                None if own is None else loaded(own),
                given(learned.inputs["shot_keypoints"]),
            )


def loaded(leaf: Any) -> Any:
    files = {name: path.read_bytes() for name, path in leaf.files.items()}
    return leaf.load(files, {**leaf.values, **leaf.context})


def area(scores: list[ShapeScore | None]) -> float:
    """Mean over thresholds of the IoU of all counts together; NaN where nothing is annotated."""
    known = [one for one in scores if one is not None]
    if not known:
        return float("nan")
    kinds = ("true_positives", "false_positives", "false_negatives")
    true, false, missed = (np.sum([getattr(one, kind) for one in known], axis=0) for kind in kinds)
    return float((true / np.maximum(true + false + missed, 1)).mean())
