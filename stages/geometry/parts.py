"""Part labels between a shape's candidates and the points that they were annotated at."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from b23d.schemas.parts import Parts
from b23d.schemas.shape import NormalizedShape


def part_names(annotated: Mapping[str, Parts]) -> list[str]:
    """The parts that all these shapes' labels count; where none has names, "0", "1", … as far as the labels go.

    `annotated`: name for messages → its parts. Raises ValueError: other names in one shape than in another, a label
    beyond the names.
    """
    lists = {name: parts.names for name, parts in annotated.items() if parts.names}
    if len({tuple(names) for names in lists.values()}) > 1:
        told = "; ".join(f"{name}: {', '.join(names)}" for name, names in lists.items())
        raise ValueError(f"parts: expected the same names in every shape of a class, got {told}; mend the annotations")
    most = max((int(parts.labels.max(initial=-1)) for parts in annotated.values()), default=-1)
    names = next(iter(lists.values()), [str(i) for i in range(most + 1)])
    for name, parts in annotated.items():
        wrong = parts.labels[(parts.labels < 0) | (parts.labels >= len(names))]
        if len(wrong):
            raise ValueError(
                f"{name}: expected part labels below {len(names)} ({', '.join(names)}), got {wrong[0]}; "
                "mend the annotation"
            )
    return names


def candidate_labels(parts: Parts, shape: NormalizedShape, name: str = "the shape") -> npt.NDArray[np.int32]:
    """The label of each candidate, (n,) int32: that of the annotated point nearest to it. Raises ValueError where there
    is none."""
    _check(parts, name)
    return parts.labels[_nearest(shape.to_unit(parts.points), shape.points.astype(np.float64))]


def at_annotated(
    labels: np.ndarray, parts: Parts, shape: NormalizedShape, name: str = "the shape"
) -> npt.NDArray[np.int32]:
    """Candidates' labels (n,) at the annotated points, (p,) int32: each takes the nearest candidate's. Raises as
    `candidate_labels`."""
    _check(parts, name)
    return labels[_nearest(shape.points.astype(np.float64), shape.to_unit(parts.points))].astype(np.int32)


def _nearest(of: np.ndarray, to: np.ndarray) -> np.ndarray:
    from scipy.spatial import cKDTree

    return np.asarray(cKDTree(of).query(to)[1], np.int64).reshape(-1)


def _check(parts: Parts, name: str) -> None:
    if not len(parts.points) or not np.isfinite(parts.points).all():
        got = "none" if not len(parts.points) else "NaN or infinity"
        raise ValueError(
            f"{name}: expected points with part labels, got {got}; label the shape, or leave its parts out"
        )
