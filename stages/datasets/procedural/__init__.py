"""Procedural: a data set of chairs, tables, airplanes, mugs and quadrupeds made by the program itself, with exact
keypoints and part labels.

Shape i of a class depends on (class, seed, i) only, so raising `count` changes none that were there.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from pydantic import Field

from b23d.pipeline.dataset import Leaf, Shape, dataset
from b23d.schemas.keypoints import Keypoints
from b23d.schemas.parts import Parts
from b23d.schemas.shape import Source
from b23d.stages.datasets.damage import WithDamage

if TYPE_CHECKING:
    from b23d.stages.datasets.procedural.assembling import BuiltShape

Category = Literal["chair", "table", "airplane", "mug", "quadruped"]
VERSION = 2
"""Raise it when the shapes change: it enters their addresses."""


@dataset("procedural")
class Procedural(WithDamage):
    kind: Literal["procedural"]
    classes: list[Category] = ["chair", "table", "airplane", "mug"]
    """Quadrupeds (horses, dogs, cattle, goats, cats) where they are asked for."""
    count: int = Field(12, ge=1, le=10_000)
    """Shapes of each class."""
    seed: int = 0

    def annotations_kept(self) -> str:
        return "its keypoints are exact by construction and have no file"

    def shapes(self) -> list[Shape]:
        """All shapes, named `chair/chair-0000` …"""
        return [self._shape(category, index) for category in sorted(set(self.classes)) for index in range(self.count)]

    def _shape(self, category: str, index: int) -> Shape:
        key = {"class": category, "seed": self.seed, "index": index, "version": VERSION}
        leaves = {
            "source": Leaf(load_source, {"leaf": "source", **key}),
            "keypoints": Leaf(load_keypoints, {"leaf": "keypoints", **key}),
            "parts": Leaf(load_parts, {"leaf": "parts", **key}),
        }
        return Shape(f"{category}-{index:04d}", category, leaves)


def load_source(files: dict[str, bytes], values: dict[str, Any]) -> Source:
    """The shape as a binary PLY."""
    name = f"{values['class']}/{values['class']}-{values['index']:04d}"
    return Source(shape=name, files={"mesh.ply": _model(values).ply()}, mesh="mesh.ply")


def load_keypoints(files: dict[str, bytes], values: dict[str, Any]) -> Keypoints:
    """The exact keypoints; the ids that a shape lacks (arms, engines) are not there."""
    model = _model(values)
    return Keypoints(
        ids=model.keypoint_ids,
        positions=model.keypoints,
        point_indices=np.full(len(model.keypoint_ids), -1, np.int32),
        reflections=model.reflections,
        rotations=model.rotations,
    )


def load_parts(files: dict[str, bytes], values: dict[str, Any]) -> Parts:
    """The part of every face, at its centroid."""
    model = _model(values)
    return Parts(points=model.centroids(), labels=model.face_labels, names=model.part_names)


def generated(category: str, seed: int, index: int) -> BuiltShape:
    """Shape `index` of a class: its surface, keypoints, parts, and the style that was drawn."""
    from b23d.stages.datasets.procedural.airplanes import airplane
    from b23d.stages.datasets.procedural.chairs import chair
    from b23d.stages.datasets.procedural.drawing import Chance
    from b23d.stages.datasets.procedural.mugs import mug
    from b23d.stages.datasets.procedural.quadrupeds import quadruped
    from b23d.stages.datasets.procedural.tables import table

    make = {"chair": chair, "table": table, "airplane": airplane, "mug": mug, "quadruped": quadruped}[category]
    return make(Chance(category, seed, index))


def _model(values: dict[str, Any]) -> BuiltShape:
    return generated(values["class"], values["seed"], values["index"])
