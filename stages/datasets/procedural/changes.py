"""Shapes changed in one place: both versions with the same faces, and the same vertices but where they were changed."""

from __future__ import annotations

import numpy as np

from b23d.stages.datasets.procedural import generated
from b23d.stages.datasets.procedural.assembling import BuiltShape
from b23d.stages.datasets.procedural.drawing import Chance
from b23d.stages.datasets.procedural.isometric import isometric_cubes
from b23d.stages.datasets.procedural.quadrupeds import AT_EASE, GRAZING, quadruped
from b23d.stages.datasets.procedural.solids import Solid

LONGER = 1.4
"""A box's length over its width: more than width and dent together, so that its dent does not change its scale."""


def dented_cubes() -> tuple[Solid, Solid]:
    """The two isometric cubes, their dented side in front (-z): dented in, dented out."""
    first, second = isometric_cubes()
    return first.placed(_facing_front), second.placed(_facing_front)


def dented_boxes() -> tuple[Solid, Solid]:
    """The same, `LONGER` in x: still isometric, and of one longest side."""
    long = np.array([LONGER, 1.0, 1.0])
    first, second = dented_cubes()
    return Solid(first.vertices * long, first.faces), Solid(second.vertices * long, second.faces)


def bumped_table(reach: float = 0.13, height: float = 0.06) -> tuple[Solid, Solid]:
    """A table; with a smooth bump, (1 - (r / reach)²)² times its height, on its top, nearer to its right end."""
    model = generated("table", 0, 1)
    before = model.vertices.astype(np.float64)
    top, middle = before[:, 1].max(), np.array([0.55 * before[:, 0].max(), 0.0])
    distance = np.linalg.norm(before[:, [0, 2]] - middle, axis=1)
    rise = height * np.maximum(0.0, 1 - (distance / reach) ** 2) ** 2 * (before[:, 1] > top - 1e-6)
    return _both(model, before + rise[:, None] * np.array([0.0, 1.0, 0.0]))


def stretched_airplane(start: float = 0.1, factor: float = 1.3) -> tuple[Solid, Solid]:
    """An airplane; with its body behind `start` (z) drawn out. Wings, engines and tail stay, and the span stays the
    longest side."""
    model = generated("airplane", 0, 12)
    after = model.vertices.astype(np.float64)
    rear = _of_part(model, "body") & (after[:, 2] > start)
    after[rear, 2] = start + factor * (after[rear, 2] - start)
    return _both(model, after)


def raised_engines() -> tuple[Solid, Solid]:
    """An airliner; with its engines, each turned half about its own line in the wing, above the wings."""
    model = generated("airplane", 0, 1)
    after = model.vertices.astype(np.float64)
    wing, engine = _of_part(model, "wing"), _of_part(model, "engine")
    for side in (-1.0, 1.0):
        own = engine & (side * after[:, 0] > 0)
        x = (after[own, 0].min() + after[own, 0].max()) / 2
        beside = wing & (np.abs(model.vertices[:, 0] - x) < 0.05)
        axis = np.array([x, model.vertices[beside, 1].mean()])
        after[own, :2] = 2 * axis - after[own, :2]
    return _both(model, after)


def grazing_horse() -> tuple[Solid, Solid]:
    """A horse; with a step, and its head at the ground. Trunk and tail stay."""
    standing, grazing = (quadruped(Chance("quadruped", 0, 0), posture) for posture in (AT_EASE, GRAZING))
    trunk = _of_part(standing, "tail")  # shapes are scaled by their own boxes
    scale = np.linalg.norm(standing.vertices[trunk]) / np.linalg.norm(grazing.vertices[trunk])
    return _both(standing, grazing.vertices.astype(np.float64) * scale)


def _facing_front(vertices: np.ndarray) -> np.ndarray:
    """What was above (+y) comes to the front (-z)."""
    return np.stack([vertices[:, 0], vertices[:, 2], -vertices[:, 1]], axis=-1)


def _of_part(model: BuiltShape, name: str) -> np.ndarray:
    """(v,) bool: the vertices of a part; parts share none."""
    chosen = np.zeros(len(model.vertices), bool)
    chosen[model.faces[model.face_labels == model.part_names.index(name)]] = True
    return chosen


def _both(model: BuiltShape, after: np.ndarray) -> tuple[Solid, Solid]:
    faces = model.faces.astype(np.int64)
    return Solid(model.vertices.astype(np.float64), faces), Solid(after, faces)
