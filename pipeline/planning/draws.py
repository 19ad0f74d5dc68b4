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
from b23d.schemas.wording import counted


@dataclass(frozen=True)
class Draw:
    """One seeded draw of shots in one class; `error` says why there is none."""

    seed: int
    category: str
    shots: tuple[Shape, ...] = ()
    targets: tuple[Shape, ...] = field(default=(), repr=False)
    error: str | None = None


def draw_shots(shapes: Iterable[Shape], shots: Shots, unusable: Collection[str], leaves: Collection[str]) -> list[Draw]:
    """Every draw of every class that has annotated shapes, or shots by name. `unusable`: names of shapes that cannot be
    shots; `leaves`: what shots are asked for."""
    classes: dict[str, list[Shape]] = defaultdict(list)
    for shape in shapes:
        classes[shape.category].append(shape)
    draws = []
    for category, members in sorted(classes.items()):
        had = {leaf for leaf in leaves if any(leaf in shape.leaves for shape in members)}
        named = category in shots.ids and bool(leaves)
        if had or named:
            for seed in shots.draws[:1] if named else shots.draws:
                draws.append(_draw(category, members, shots, seed, unusable, had or set(leaves)))
    return draws


def draw_examples(
    shapes: Iterable[Shape], shots: Shots, unusable: Collection[str], leaves: Collection[str]
) -> dict[str, tuple[Shape, ...]]:
    """Of every class, its examples: the shots of its first draw, or as many shapes as have all the leaves; by name.

    They are known before anything is made: a shot that fails later is replaced in its draw, and stays an example.
    """
    classes: dict[str, list[Shape]] = defaultdict(list)
    for shape in shapes:
        if set(leaves) <= shape.leaves.keys() and shape.name not in unusable:
            classes[shape.category].append(shape)
    seed, found = next(iter(shots.draws), 0), {}
    for category, members in classes.items():
        named = shots.ids.get(category)
        pool = [shape for shape in members if named is None or shape.id in named]
        if named is None and shots.split == "official":
            pool = [shape for shape in pool if shape.official == "train"]
        found[category] = tuple(sorted(_ranked(pool, seed)[: shots.count if named is None else None], key=_by_name))
    return found


def draw_problems(
    shapes: Collection[Shape], shots: Shots, draws: Collection[Draw], leaves: Collection[str]
) -> dict[str, bool]:
    """What is wrong with the shots as a whole, each said once → whether the run file names what is not there: draws
    without shots, unknown classes in `shots.ids`. Nothing annotated at all is for the data set to tell. None where the
    run asks for no shots."""
    if not leaves:
        return {}
    told = {draw.error: draw.category in shots.ids for draw in draws if draw.error}
    classes = sorted({shape.category for shape in shapes})
    for category in shots.ids:
        if category not in classes:
            told[f"shots.ids: expected classes among {', '.join(classes)}, got {category}; check the run file"] = True
    return told


def unannotated_classes(shapes: Iterable[Shape], shots: Shots, leaves: Collection[str]) -> dict[str, str]:
    """Class that has not all the leaves that shots are asked for → what follows. What is wrong with shots by name is
    told of their draws."""
    had: dict[str, set[str]] = defaultdict(set)
    for shape in shapes:
        if not shape.error and shape.category not in shots.ids:
            had[shape.category] |= shape.leaves.keys()
    lacking = {category: sorted(set(leaves) - found) for category, found in sorted(had.items())}
    return {
        category: f"no annotated {'shapes' if len(lack) == len(leaves) else ' or '.join(lack)}, "
        f"so no {' and no '.join(lack)} are predicted"
        for category, lack in lacking.items()
        if lack
    }


def draw_notes(draws: Collection[Draw]) -> list[str]:
    """What of the draws is not as it may seem, a line each: draws of one class that have the same shots."""
    classes: dict[str, dict[frozenset[str], list[int]]] = defaultdict(lambda: defaultdict(list))
    for draw in draws:
        if draw.shots:
            classes[draw.category][frozenset(shot.id for shot in draw.shots)].append(draw.seed)
    notes = []
    for category, by_shots in classes.items():
        for shots, seeds in by_shots.items():
            if len(seeds) > 1:
                which = ", ".join(map(str, seeds))
                same = counted(len(shots), "shot")
                told = f"draws {which} have the same {same} and are one draw: no spread comes of them"
                notes.append(f"class {category}: {told}; annotate more, or set shots.draws")
    return notes


def _draw(
    category: str, members: list[Shape], options: Shots, seed: int, unusable: Collection[str], leaves: set[str]
) -> Draw:
    annotated = [shape for shape in members if leaves <= shape.leaves.keys()]
    usable = [shape for shape in annotated if shape.name not in unusable]
    if named := options.ids.get(category):
        chosen = [shape for shape in usable if shape.id in named]
        if len(chosen) < len(set(named)):
            return Draw(seed, category, error=_lost(category, named, members, annotated, usable))
    else:
        pool = [shape for shape in usable if options.split == "all-but-shots" or shape.official == "train"]
        chosen = _ranked(pool, seed)[: options.count]
        if len(chosen) < options.count:
            got = f"expected {counted(options.count, 'annotated shape')} as shots, got {len(chosen)}"
            if refused := len(annotated) - len(usable):
                got += f" and {refused} that cannot be used"
            return Draw(seed, category, error=f"class {category}: {got}; annotate more, or lower shots.count")
    names = {shape.name for shape in chosen}
    targets = tuple(
        s for s in members if s.name not in names and (options.split == "all-but-shots" or s.official == "test")
    )
    return Draw(seed, category, tuple(sorted(chosen, key=_by_name)), targets)


def _ranked(pool: Iterable[Shape], seed: int) -> list[Shape]:
    return sorted(pool, key=lambda shape: sha256(f"{seed}:{shape.name}"))


def _by_name(shape: Shape) -> str:
    return shape.name


def _lost(
    category: str, named: Collection[str], members: list[Shape], annotated: list[Shape], usable: list[Shape]
) -> str:
    """Why shapes that the run file names cannot be shots."""
    reasons = []
    known, with_keypoints, fine = ({shape.id for shape in part} for part in (members, annotated, usable))
    for name in sorted(set(named) - fine):
        why = "is not there" if name not in known else "has no annotation"
        reasons.append(f"{name} {'cannot be used' if name in with_keypoints else why}")
    return f"class {category}: expected the shots that shots.ids names, got {', '.join(reasons)}; check shots.ids"
