"""How two artifacts of one schema differ: the first array, or field, that is not equal, and by how much."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from b23d.schemas.artifact import Artifact


@dataclass(frozen=True)
class Differing:
    """One array or field in which two artifacts differ."""

    name: str
    how: str
    """In words: `shape (8, 3), was (9, 3)`, `3 of 24 differ, at most by 0.25 (at [1, 2]: 0.5, was 0.25)`."""

    def __str__(self) -> str:
        return f"{self.name}: {self.how}"


def differences(now: Artifact, before: Artifact) -> list[Differing]:
    """Every array and field that differs, in the schema's order; NaNs in the same places are equal.

    Raises TypeError where the two are of different schemas.
    """
    if type(now) is not type(before):
        raise TypeError(f"artifacts: expected two of one schema, got {type(now).__name__} and {type(before).__name__}")
    arrays, others = now.present_arrays(), before.present_arrays()
    found = []
    for name in now.array_specs():
        if name in arrays and name in others:
            how = _array(arrays[name], others[name])
        elif name in arrays or name in others:
            how = "there, was absent" if name in arrays else "absent, was there"
        else:
            how = ""
        if how:
            found.append(Differing(name, how))
    fields, known = now.plain_fields(), before.plain_fields()
    for name, value in fields.items():
        if value != known[name]:
            found.append(Differing(name, f"{value!r}, was {known[name]!r}"))
    return found


def _array(now: np.ndarray, before: np.ndarray) -> str:
    if now.shape != before.shape or now.dtype != before.dtype:
        return f"{now.dtype} {now.shape}, was {before.dtype} {before.shape}"
    equal = now == before
    if now.dtype.kind == "f":
        equal |= np.isnan(now) & np.isnan(before)
    if equal.all():
        return ""
    count = f"{int((~equal).sum())} of {equal.size} differ"
    if now.dtype.kind not in "fiu":
        return count
    with np.errstate(invalid="ignore"):
        gaps = np.where(equal, 0, np.abs(now.astype(np.float64) - before.astype(np.float64)))
    worst = int(np.argmax(np.where(np.isnan(gaps), np.inf, gaps)))
    place = [int(i) for i in np.unravel_index(worst, now.shape)]
    gap = gaps.flat[worst]
    return f"{count}, at most by {gap:.4g} (at {place}: {now.flat[worst]:.6g}, was {before.flat[worst]:.6g})"
