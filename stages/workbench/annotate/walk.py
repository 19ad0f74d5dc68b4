"""A walk through the shapes that a run needs annotated: one session a shape, and what is next."""

from __future__ import annotations

import threading
from collections import OrderedDict
from functools import partial
from pathlib import Path
from typing import Any

from b23d.pipeline.dataset import Shape
from b23d.pipeline.run import Run
from b23d.stages.workbench.annotate.entries import read_entries
from b23d.stages.workbench.annotate.looks import Looks, looks_of
from b23d.stages.workbench.annotate.needed import ClassNeeds, beside, class_needs, next_needed
from b23d.stages.workbench.annotate.proposing import proposed
from b23d.stages.workbench.annotate.session import Session
from b23d.stages.workbench.annotate.upright import standing

KEPT = 4
"""Sessions held at once: a tab that shows another is served from the files again."""


class Walk:
    """All that pages may show of a run. Any number of pages and threads may share it."""

    def __init__(self, run: Run, name: str | None = None, keypoints: Path | None = None) -> None:
        """`name`: the shape to begin with; None: the next one needed. `keypoints`: the file to write to; None: the
        data set's own. Raises as `Session` and `next_needed`."""
        self.run, self.keypoints = run, keypoints
        self._shapes, self._stale, self._lock = list(run.shapes), False, threading.Lock()
        self._sessions: OrderedDict[str, Session] = OrderedDict()
        self._looks: dict[tuple[str, ...], Looks] = {}
        self.first = next_needed(self.needs()) if name is None else name
        self.at(self.first)

    def at(self, name: str | None = None) -> Session:
        """The session of a shape; None: of the first."""
        name = name or self.first
        with self._lock:
            self._refresh()
            if name not in self._sessions:
                self._sessions[name] = Session(
                    self.run.config.dataset, self._shapes, name, self.keypoints, partial(standing, self.run)
                )
            self._sessions.move_to_end(name)
            while len(self._sessions) > KEPT:
                self._sessions.popitem(last=False)
            return self._sessions[name]

    def page(self, name: str | None = None) -> dict[str, Any]:
        """What the page is told of a shape, and where the walk stands."""
        page = self.at(name).page()
        return {**page, "walk": self.around(page["name"])}

    def save(self, name: str | None = None, **edited: Any) -> dict[str, Any]:
        """As `Session.save`, and where the walk stands then."""
        session = self.at(name)
        answer = session.save(**edited)
        with self._lock:
            self._stale = True
        return {**answer, "walk": self.around(session.shape.name)}

    def around(self, name: str) -> dict[str, str | None]:
        """`previous`, `next` (None: there is none), and `told`: how many shots of the class there are."""
        needs = self.needs()
        before, after = beside(needs, name)
        told = next((each.told for each in needs if name in each.order), "")
        return {"previous": before, "next": after, "told": told}

    def needs(self) -> list[ClassNeeds]:
        with self._lock:
            self._refresh()
            shapes = self._shapes
        entries = [] if self.keypoints is None else read_entries(self.keypoints)
        elsewhere = {(entry.get("model_id"), entry.get("class_id")) for entry in entries}

        def annotated(shape: Shape) -> bool:
            ids = self.run.config.dataset.class_ids(shape.category) if elsewhere else ()
            return "keypoints" in shape.leaves or any((shape.id, each) in elsewhere for each in ids)

        return class_needs(shapes, self.run.config.file.shots, annotated, self._propose)

    def _propose(self, names: list[str], annotated: set[str]) -> tuple[list[str], str]:
        """Which of a class's shapes should be next; in no order of its own where nothing is stored to tell by."""
        looks = self._looks.get(key := tuple(names))
        if looks is None:
            looks = self._looks[key] = looks_of(self.run, names)
        known = {name: i for i, name in enumerate(looks.names)}
        done = [known[name] for name in names if name in annotated and name in known]
        return [looks.names[i] for i in proposed(looks.alike, done, list(known.values()))], looks.told

    def _refresh(self) -> None:
        """After a save the shape stands beside the others. The caller holds the lock."""
        if self._stale:
            self._shapes, self._stale = self.run.config.dataset.listed(), False
            self._sessions.clear()
