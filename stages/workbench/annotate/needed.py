"""Which shapes a run still needs annotated, and in which order one walks through them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from b23d.pipeline.dataset import Shape
from b23d.schemas.runfile import Shots
from b23d.schemas.wording import counted


@dataclass(frozen=True)
class ClassNeeds:
    """A class as the annotator meets it."""

    category: str
    order: list[str]
    """Its shapes that can be read: those that `shots.ids` names first; else, while the class lacks shots, the annotated
    ones and then what is proposed; then by name."""
    bare: list[str]
    """Those without keypoints."""
    needed: list[str]
    """Those of `bare` of which a shot may be made; none where the class has its shots."""
    annotated: int
    shots: int
    by: str = ""
    """What the next ones are proposed by; "" where they come by name."""

    @property
    def told(self) -> str:
        has = min(self.annotated, self.shots)
        more = f", {self.annotated - has} more annotated" if self.annotated > has else ""
        by = f"; the next is {self.by}" if self.by and self.needed else ""
        return f"{self.category}: {has} of {counted(self.shots, 'shot')} annotated{more}{by}"


Propose = Callable[[list[str], set[str]], tuple[list[str], str]]
"""From a class's shapes by name, and which of them are annotated, to those that should be next, and what by."""


def class_needs(
    shapes: Iterable[Shape], shots: Shots, annotated: Callable[[Shape], bool], propose: Propose | None = None
) -> list[ClassNeeds]:
    """What every class needs, sorted by its name."""
    classes: dict[str, list[Shape]] = defaultdict(list)
    for shape in shapes:
        if shape.error is None:
            classes[shape.category].append(shape)
    needs = []
    for category, members in sorted(classes.items()):
        named = shots.ids.get(category, [])
        members = sorted(members, key=lambda shape: (shape.id not in named, shape.name))
        may = [shape for shape in members if shape.id in named] if named else members
        has = sum(annotated(shape) for shape in may)
        count, by = len(named) or shots.count, ""
        if propose is not None and not named and has < count:
            members, by = _as_proposed(members, {shape.name for shape in members if annotated(shape)}, propose)
            may = members
        bare = [shape for shape in members if not annotated(shape)]
        needed = [shape.name for shape in bare if shape in may] if has < count else []
        needs.append(ClassNeeds(category, [s.name for s in members], [s.name for s in bare], needed, has, count, by))
    return needs


def _as_proposed(members: list[Shape], done: set[str], propose: Propose) -> tuple[list[Shape], str]:
    """The annotated ones, those proposed, the others; and what by."""
    ahead, by = propose([shape.name for shape in members], done)
    place = {name: i for i, name in enumerate(ahead)}

    def rank(shape: Shape) -> tuple[int, int]:
        return (0, 0) if shape.name in done else (1, place[shape.name]) if shape.name in place else (2, 0)

    return sorted(members, key=rank), by if ahead else ""


def next_needed(needs: list[ClassNeeds]) -> str:
    """The first shape of which a shot is wanted; where none is, the first without keypoints (it gets scores then).
    Raises ValueError where every shape has an annotation."""
    for names in (*(each.needed for each in needs), *(each.bare for each in needs)):
        if names:
            return names[0]
    raise ValueError("annotate: expected a shape without keypoints, got none; name one to change its keypoints")


def beside(needs: list[ClassNeeds], name: str) -> tuple[str | None, str | None]:
    """The shapes before and after one. After: the next that is needed, from the end back to the first; where none is
    needed, the next at all. Before: the one before that is annotated or needed; where none is needed, any."""
    order = [shape for each in needs for shape in each.order]
    needed = {shape for each in needs for shape in each.needed}
    passed = {shape for each in needs for shape in each.bare} - needed if needed else set()
    place = order.index(name) if name in order else -1
    ahead, behind = order[place + 1 :], order[: max(place, 0)]
    following = (
        next((shape for shape in ahead + behind if shape in needed), None)
        if needed - {name}
        else next(iter(ahead), None)
    )
    return next((shape for shape in reversed(behind) if shape not in passed), None), following
