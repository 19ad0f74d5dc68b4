"""The part table of a run: mean over a class's shapes, then over classes, then mean and spread over draws of shots."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from b23d.schemas.scores import PartClass, PartScore, PartTable, Spread
from b23d.schemas.wording import averaged

if TYPE_CHECKING:
    from rich.table import Table

PartRow = tuple[str, int, str, PartScore]
"""Category, draw, shape, score."""


def part_table(run: str, rows: Iterable[PartRow]) -> PartTable:
    """The table of `rows`; classes are sorted by name.

    Raises ValueError where there is no row, or where scores follow different protocols.
    """
    by_class: dict[str, dict[int, dict[str, PartScore]]] = defaultdict(lambda: defaultdict(dict))
    for category, draw, shape, scored in rows:
        by_class[category][draw][shape] = scored
    protocols = {one.protocol for draws in by_class.values() for shapes in draws.values() for one in shapes.values()}
    if len(protocols) != 1:
        got = "none" if not protocols else " | ".join(sorted(protocols))
        raise ValueError(
            f"part scores of {run}: expected scored shapes of one protocol, got {got}; "
            "run it first, or re-run score_parts"
        )
    means: dict[str, dict[int, float]] = {}
    instances: dict[int, list[float]] = defaultdict(list)
    for category, draws in by_class.items():
        means[category] = {}
        for draw, shapes in draws.items():
            ious = [one.iou for one in shapes.values()]
            means[category][draw] = float(np.mean(ious))
            instances[draw] += ious

    shared = sorted(set.intersection(*(set(draws) for draws in means.values())))
    if shared:
        over_classes = [float(np.mean([draws[draw] for draws in means.values()])) for draw in shared]
    else:  # no draw that every class has
        own = [float(np.mean(list(draws.values()))) for draws in means.values()]
        over_classes = [float(np.mean(own))]
    return PartTable(
        run=run,
        protocol=protocols.pop(),
        classes={category: _class(by_class[category], means[category]) for category in sorted(by_class)},
        mean=_spread(over_classes),
        instances=_spread([float(np.mean(values)) for values in instances.values()]),
    )


def render(table: PartTable, coverage: str = "") -> Table:
    """One row a class, then the average over classes and over shapes; IoU in percent, as the literature has it, ± sd
    over draws."""
    from rich.markup import escape
    from rich.table import Table

    draws = max(one.draws for one in table.classes.values())
    result = Table(
        title=escape(f"{table.run}: parts" + (f" ({coverage})" if coverage else "")),
        caption=f"IoU in %; {table.protocol}; {averaged(draws)}",
    )
    for name, justify in (("class", "left"), ("targets", "right"), ("IoU", "right"), ("of each part", "left")):
        result.add_column(name, justify="right" if justify == "right" else "left")
    for name, one in table.classes.items():
        parts = ", ".join(f"{part} {'–' if iou is None else f'{100 * iou:.1f}'}" for part, iou in one.parts.items())
        result.add_row(escape(name), str(one.targets), _percent(one.iou, one.draws), escape(parts))
    targets = str(sum(one.targets for one in table.classes.values()))
    result.add_section()
    result.add_row("mean over classes", targets, _percent(table.mean, draws), "", style="bold")
    result.add_row("mean over shapes", targets, _percent(table.instances, draws), "")
    return result


def _class(draws: dict[int, dict[str, PartScore]], means: dict[int, float]) -> PartClass:
    scores = [one for shapes in draws.values() for one in shapes.values()]
    found: dict[str, list[float]] = {name: [] for name in scores[0].names}
    for one in scores:
        for i in np.flatnonzero(one.present):
            found[one.names[i]].append(one.intersection[i] / one.union[i])
    return PartClass(
        targets=len({shape for shapes in draws.values() for shape in shapes}),
        draws=len(draws),
        iou=_spread(list(means.values())),
        parts={name: float(np.mean(values)) if values else None for name, values in found.items()},
    )


def _spread(values: list[float]) -> Spread:
    return Spread(mean=float(np.mean(values)), sd=float(np.std(values, ddof=1)) if len(values) > 1 else 0.0)


def _percent(spread: Spread, draws: int) -> str:
    return f"{100 * spread.mean:.1f}" + (f" ±{100 * spread.sd:.1f}" if draws > 1 else "")
