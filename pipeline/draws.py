"""Which annotated shapes are the shots of a draw, and which shapes are its targets.

A shape is annotated if it has the leaves that the run's stages ask of shots (`shot_keypoints`, `shot_parts` …), as far
as any shape of its class has them. Shapes rank by sha256(draw, shape name); a class's first `count` usable ones are its
shots. So a draw is the same on every machine, a new shape changes it only by being drawn, and a shape that is
quarantined is replaced by the next in rank.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field

from b23d.pipeline.address import sha256
from b23d.pipeline.dataset import Shape
from b23d.schemas.runfile import Shots


@dataclass(frozen=True)
class Draw:
    """One seeded draw of shots in one class; `error` says why there is none."""

    seed: int
    category: str
    shots: tuple[Shape, ...] = ()
    targets: tuple[Shape, ...] = field(default=(), repr=False)
    error: str | None = None


def draw_shots(shapes: Iterable[Shape], shots: Shots, unusable: Collection[str], leaves: Collection[str]) -> list[Draw]:
    """Every draw of every class that has annotated shapes. `unusable`: names of shapes that cannot be shots; `leaves`:
    what shots are asked for."""
    classes: dict[str, list[Shape]] = defaultdict(list)
    for shape in shapes:
        classes[shape.category].append(shape)
    return [
        _draw(category, members, shots, seed, unusable, had)
        for category, members in sorted(classes.items())
        if (had := {leaf for leaf in leaves if any(leaf in shape.leaves for shape in members)})
        for seed in (shots.draws if category not in shots.ids else shots.draws[:1])
    ]


def _draw(
    category: str, members: list[Shape], options: Shots, seed: int, unusable: Collection[str], leaves: set[str]
) -> Draw:
    annotated = [shape for shape in members if leaves <= shape.leaves.keys() and shape.name not in unusable]
    if named := options.ids.get(category):
        chosen = [shape for shape in annotated if shape.id in named]
        if len(chosen) < len(named):
            lost = ", ".join(sorted(set(named) - {shape.id for shape in chosen}))
            reason = f"class {category}: expected annotated shapes {lost} as shots, got none usable; check shots.ids"
            return Draw(seed, category, error=reason)
    else:
        pool = [shape for shape in annotated if options.split == "all-but-shots" or shape.official == "train"]
        chosen = sorted(pool, key=lambda shape: sha256(f"{seed}:{shape.name}"))[: options.count]
        if len(chosen) < options.count:
            got = f"expected {options.count} annotated shapes as shots, got {len(chosen)}"
            return Draw(seed, category, error=f"class {category}: {got}; annotate more, or lower shots.count")
    names = {shape.name for shape in chosen}
    targets = tuple(
        s for s in members if s.name not in names and (options.split == "all-but-shots" or s.official == "test")
    )
    return Draw(seed, category, tuple(sorted(chosen, key=lambda shape: shape.name)), targets)
