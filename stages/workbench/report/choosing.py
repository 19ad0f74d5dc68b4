"""Which shapes get pictures and 3D views, and what their files are called."""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from typing import Any

from b23d.pipeline.dataset import Shape

EXTREMES = 3  # best and worst shapes of a class that always have a 3D view


def detailed(rows: list[dict[str, Any]], limit: int) -> set[int]:
    """Places of at most `limit` shapes to show in 3D: all, or each class's best and worst, the shots, then evenly the
    rest."""
    usable = [place for place, row in enumerate(rows) if row["points"]]
    if len(usable) <= limit:
        return set(usable)
    by_class: dict[str, list[int]] = defaultdict(list)
    for place in usable:
        if rows[place]["auc"] is not None:
            by_class[rows[place]["category"]].append(place)
    ranked = [sorted(places, key=lambda place: rows[place]["auc"]) for places in by_class.values()]
    wanted = [place for places in ranked for place in [*places[:EXTREMES], *places[-EXTREMES:]]]
    wanted += [place for place in usable if rows[place]["shot"]]
    first = dict.fromkeys(wanted)
    rest = [place for place in usable if place not in first]
    room = max(0, limit - len(first))
    even = [rest[i * len(rest) // room] for i in range(min(room, len(rest)))]
    return set([*first, *even][:limit])


def best_and_worst(rows: list[dict[str, Any]]) -> list[tuple[int, str]]:
    """Each class's shape of largest and of smallest mean AUC, as (place, "best" | "worst"); one of one is "best"."""
    by_class: dict[str, list[int]] = defaultdict(list)
    for place, row in enumerate(rows):
        if row["auc"] is not None:
            by_class[row["category"]].append(place)
    found = []
    for _, places in sorted(by_class.items()):
        ranked = sorted(places, key=lambda place: rows[place]["auc"])
        found.append((ranked[-1], "best"))
        if len(ranked) > 1:
            found.append((ranked[0], "worst"))
    return found


def file_keys(shapes: list[Shape]) -> list[str]:
    """A file name of plain characters for every shape, unique regardless of case."""
    names = [re.sub(r"[^A-Za-z0-9._-]+", "-", shape.name.replace("/", "-")).strip(".") or "shape" for shape in shapes]
    often = Counter(name.lower() for name in names)
    return [f"{name}-{place}" if often[name.lower()] > 1 else name for place, name in enumerate(names)]
