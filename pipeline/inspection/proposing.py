"""Commands that messages propose: of the same run as this one was told of, to be pasted into a shell."""

from __future__ import annotations

import shlex
from collections.abc import Collection

from b23d.pipeline.planning.selection import EVERYTHING, WORDS, Selection
from b23d.pipeline.run import Run
from b23d.pipeline.store import Store

NAMED = ("shapes", "classes")
"""What commands that read results take of a selection."""


def proposed(
    verb: str, run: Run, *words: str, selection: Selection = EVERYTHING, taking: Collection[str] = NAMED
) -> str:
    """`b23d <verb> RUN <words>` with the run's overrides and its store, and what the verb takes of a selection.

    taking: fields of the selection."""
    parts = ["b23d", verb, str(run.config.path), *words]
    for text in run.config.overrides:
        parts += ["--set", text]
    if run.store.url != Store(run.config.file.store.root).url:
        parts += ["--store", run.store.url]
    for field, option in WORDS.items():
        value = getattr(selection, field) if field in taking else None
        if isinstance(value, bool) or value is None:
            parts += [option] * bool(value)
        else:
            parts += [part for one in (value if isinstance(value, tuple) else (value,)) for part in (option, str(one))]
    return shlex.join(parts)
