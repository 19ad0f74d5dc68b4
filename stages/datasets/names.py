"""What people call the keypoints of a class: names live in the annotation file, beside the ids."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable

from b23d.pipeline.dataset import Shape

LONGEST = 80  # characters of a name


def keypoint_names(shapes: Iterable[Shape]) -> dict[str, dict[int, str]]:
    """Class → semantic id → name, from all annotated shapes of each class. Reads nothing: listing has read the names.

    Where shapes of a class call an id differently, the name that most of them use counts, of equally many the first in
    the alphabet. Ids that nobody has named are absent: show the id itself for them, as `keypoint_label` does.
    """
    counts: dict[tuple[str, int], Counter[str]] = defaultdict(Counter)
    for shape in shapes:
        leaf = shape.leaves.get("keypoints")
        for id, name in (leaf.context.get("names", {}) if leaf else {}).items():
            counts[shape.category, id][name] += 1
    found: dict[str, dict[int, str]] = defaultdict(dict)
    for (category, id), used in sorted(counts.items()):
        found[category][id] = min(used, key=lambda name: (-used[name], name))
    return dict(found)


def keypoint_label(id: int, names: dict[int, str]) -> str:
    """`3 (left wing tip)`, or `3` where the class's `names` have none for it."""
    return f"{id} ({names[id]})" if id in names else str(id)
