"""Which store a verb looks into, that is about a store more than about a run."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from b23d.pipeline.errors import RunFileError
from b23d.pipeline.inspection.again import STORE
from b23d.pipeline.run import Run
from b23d.pipeline.store import Store


def store_of(run: Path | None, overrides: Sequence[str], store: str | None) -> Store:
    """The store of a run file with its overrides, or the one named, or that of verbs without a run file. Raises
    RunFileError, also for overrides of nothing, and FileNotFoundError."""
    if run is not None:
        return Run.load(run, overrides, store).store
    if overrides:
        raise RunFileError(f"--set {overrides[0]}: expected a run file to override, got none; name one")
    return Store(store or STORE)
