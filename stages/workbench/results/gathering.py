"""What a run has made, read once: one Entry a shape, with what was found of it. Everything a page shows comes from
here."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from b23d.pipeline.dataset import Shape
from b23d.pipeline.errors import B23dError
from b23d.pipeline.planning.nodes import State
from b23d.pipeline.planning.plan import Plan
from b23d.pipeline.run import Run
from b23d.pipeline.runfile.config import feeding
from b23d.schemas.artifact import Artifact
from b23d.schemas.features import GeodesicDistances, PointFeatures
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.orientation import Orientation
from b23d.schemas.predictions import Prediction
from b23d.schemas.scores import ShapeScore
from b23d.schemas.shape import NormalizedShape
from b23d.schemas.views import Views

A = TypeVar("A", bound=Artifact)


@dataclass(frozen=True)
class Attempt:
    """One prediction of a shape, with the shots of one draw."""

    draw: int
    prediction: Prediction
    score: ShapeScore | None


@dataclass
class ShapeResults:
    """A shape and what the run has of it; arrays are read when touched."""

    shape: Shape
    shot_of: list[int]
    """Draws in which this shape is a shot."""
    normalized: NormalizedShape | None = None
    orientation: Orientation | None = None
    """Where the run file leaves it to be found what is up."""
    features: PointFeatures | None = None
    distances: GeodesicDistances | None = None
    views: Views | None = None
    keypoints: Keypoints | None = None
    attempts: list[Attempt] = field(default_factory=list)
    waiting: bool = False
    """Something of this shape is still to be made."""
    lack: str = ""
    """Why nothing is predicted of its class, if so."""
    errors: list[str] = field(default_factory=list)
    """`<stage>: <error>` of what failed."""

    def true_positions(self) -> np.ndarray:
        """(k, 3) float32 annotated keypoints in the unit frame; none without annotation."""
        if self.keypoints is None or self.normalized is None:
            return np.zeros((0, 3), np.float32)
        return self.normalized.to_unit(self.keypoints.positions).astype(np.float32)

    def attempt(self, draw: int | None = None) -> Attempt | None:
        """The attempt of a draw; of the first draw that has one, if none is named."""
        return next((attempt for attempt in self.attempts if draw in (None, attempt.draw)), None)


class Gathering:
    """The run's shapes with their artifacts. Planning is done once; the store is read shape by shape."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.plan: Plan = run.plan()
        self._draws: dict[str, list[int]] = defaultdict(list)
        self._shots: dict[str, list[int]] = defaultdict(list)
        for draw in self.plan.draws:
            self._draws[draw.category].append(draw.seed)
            for shot in draw.shots:
                self._shots[shot.name].append(draw.seed)
        self._lacks = {name: self.plan.no_shots(name) for name in {shape.category for shape in run.shapes}}
        self._waiting = {node.shape for node in self.plan.to_run()}
        self._errors: dict[str, list[str]] = defaultdict(list)
        for failure in failures(self.run, self.plan):
            self._errors[failure.shape].append(f"{failure.stage}: {failure.error}")

    def names(self) -> list[str]:
        return [shape.name for shape in self.run.shapes]

    def entry(self, shape: Shape) -> ShapeResults:
        """Raises KeyError where the data set cannot give the shape's annotation."""
        found = ShapeResults(
            shape,
            self._shots.get(shape.name, []),
            waiting=shape.name in self._waiting,
            lack=self._lacks[shape.category],
        )
        found.errors = list(self._errors.get(shape.name, []))
        found.normalized = self._read("normalize", shape, None, NormalizedShape)
        found.orientation = self._read("orient", shape, None, Orientation)
        found.features = self._read("reweight", shape, None, PointFeatures) or self._read(
            "backproject", shape, None, PointFeatures
        )
        found.distances = self._read("geodesic", shape, None, GeodesicDistances)
        found.views = self._read("render", shape, None, Views)
        found.keypoints = self._keypoints(shape, found.errors)
        for draw in self._draws.get(shape.category, []):
            prediction = self._read("optimize", shape, draw, Prediction)
            if prediction is not None:
                found.attempts.append(Attempt(draw, prediction, self._read("score", shape, draw, ShapeScore)))
        return found

    def features(self, shape: Shape, stage: str | None = None) -> PointFeatures | None:
        """The shape's features alone: those of a stage, or smoothed where the run smooths them."""
        if stage is not None:
            return self._read(stage, shape, None, PointFeatures)
        return self._read("reweight", shape, None, PointFeatures) or self._read(
            "backproject", shape, None, PointFeatures
        )

    def _read(self, upstream: str, shape: Shape, draw: int | None, schema: type[A]) -> A | None:
        """The artifact if it is there; a stage that sees no shots (a detector) is asked without the draw."""
        stage = feeding(self.run.config.file, upstream)
        node = self.plan.by_shape.get((stage, shape.name, draw)) or self.plan.by_shape.get((stage, shape.name, None))
        if (
            node is None
            or node.state is not State.CACHED
            or not issubclass(self.run.config.stages[stage].gives, schema)
        ):
            return None
        try:
            return self.run.store.read(stage, node.address, schema)
        except B23dError:
            return None

    def _keypoints(self, shape: Shape, errors: list[str]) -> Keypoints | None:
        leaf = shape.leaves.get("keypoints")
        if leaf is None:
            return None
        try:
            loaded = leaf.read()
        except (OSError, ValueError) as error:
            errors.append(f"keypoints: {type(error).__name__}: {error}")
            return None
        return loaded if isinstance(loaded, Keypoints) else None


@dataclass(frozen=True)
class Quarantined:
    """A shape that failed, and how much waits behind it."""

    shape: str
    stage: str
    error: str
    permanent: bool
    blocked: int


def failures(run: Run, plan: Plan) -> list[Quarantined]:
    """What is wrong with a run's shapes, by shape: unusable sources, classes without shots, quarantined artifacts."""
    waiting: dict[str, int] = defaultdict(int)
    for node in plan.nodes.values():
        if node.state is State.BLOCKED:
            waiting[node.shape] += 1
    reached = {address for _, address in plan.nodes}
    known = [failure for address, failure in run.index.quarantined().items() if address in reached]
    found = {
        (f.shape, f.stage): Quarantined(f.shape, f.stage, f.error, f.permanent, waiting[f.shape])
        for f in [*plan.problems, *known]
    }
    return [found[key] for key in sorted(found)]
