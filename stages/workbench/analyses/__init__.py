"""Analyses of features and predictions, one a module: what `b23d analyse` runs, by the run file's `[analysis] kind`.

Each module has `Parameters` (its fields of the `[analysis]` table), `needs` (the outputs it reads) and `analyse` (from
executed runs to a Result). None is a stage: they read what a store has, and store nothing.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from types import ModuleType
from typing import Any

KINDS = ("correspondence", "keypoints", "pca", "robustness", "semantic", "shots", "similarity", "stability")


def module_of(table: Mapping[str, Any]) -> ModuleType:
    """The module of an `[analysis]` table's kind. Raises ValueError where there is none of that name."""
    kind = table.get("kind")
    if kind not in KINDS:
        raise ValueError(
            f"analysis.kind: expected one of {', '.join(KINDS)}, got {kind!r}; "
            "add an [analysis] table, or mend its kind"
        )
    return importlib.import_module(f"b23d.stages.workbench.analyses.{kind}")
