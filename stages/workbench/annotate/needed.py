"""Which shape to annotate next, and how many shots a run still wants."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

from b23d.pipeline.dataset import Shape
from b23d.schemas.runfile import Shots


def next_needed(shapes: Iterable[Shape], shots: Shots) -> tuple[str, str]:
    """The name of the next shape, and a line on what is wanted: of the classes that want shots the first, of its shapes
    the first that `shots.ids` names and that has no annotation, else the first without one; where no shots are wanted,
    any shape without one (it gets scores then). Raises ValueError where every shape has an annotation.
    """
    classes: dict[str, list[Shape]] = defaultdict(list)
    for shape in shapes:
        if shape.error is None:
            classes[shape.category].append(shape)
    free: list[tuple[int, str, str]] = []
    for category, members in sorted(classes.items()):
        named = shots.ids.get(category, [])
        bare = [shape for shape in members if "keypoints" not in shape.leaves]
        has = len(members) - len(bare)
        count = len(named) or shots.count
        wanted = sum(shape.id in named for shape in bare) if named else max(0, count - has)
        if bare:
            first = min(bare, key=lambda shape: (shape.id not in named, shape.name))
            free.append((wanted, first.name, f"{category}: {has} annotated, {wanted} more of {count} shots wanted"))
    if not free:
        raise ValueError("annotate: expected a shape without keypoints, got none; name one to change its keypoints")
    _, name, told = next((one for one in free if one[0]), free[0])
    return name, told
