"""Claims: two runs on one store say which artifact each is making, so that neither makes the other's as well.

Advisory: `.claims/<stage>-<recipe>` holds the name of the lease of the run that makes it, and stands only while that
lease does. The store stays the truth. Whatever goes wrong with claims (a full disk, an object store, which has none)
means "no claims": then an artifact may be made twice, and is the same both times.
"""

from __future__ import annotations

import os
import uuid
from contextlib import suppress
from pathlib import Path

from b23d.pipeline.storage.roots import alive
from b23d.pipeline.store import Store

FOLDER = ".claims"


class Claims:
    """The claims of one run, which holds the lease `lease`."""

    def __init__(self, store: Store, lease: str) -> None:
        self.store, self.lease = store, lease
        self._folder = Path(store.root, FOLDER)
        self._taken: set[str] = set()
        self._text: str | None = None
        """A file that holds the lease's name: every claim is a further link to it."""

    def take(self, stage: str, recipe: str) -> bool:
        """Claim an artifact. False: another run that is going on makes it just now."""
        if not self.store.local:
            return True
        path = self._path(stage, recipe)
        try:
            return self._create(path) or (self._clear(Path(path)) and self._create(path)) or self._own(path)
        except OSError:
            return True

    def release(self, stage: str, recipe: str) -> None:
        """The artifact is made, or failed."""
        self._drop(self._path(stage, recipe))

    def release_all(self) -> None:
        for path in list(self._taken):
            self._drop(path)
        self._forget()  # of a run that won no claim, too

    def taken_elsewhere(self, stage: str, recipe: str) -> bool:
        """Whether another run that is going on still claims it."""
        holder = _holder(self._path(stage, recipe))
        return holder not in (None, self.lease) and alive(self.store, str(holder))

    def _path(self, stage: str, recipe: str) -> str:  # text: a Path each would take longer than the claim itself
        return f"{self._folder}/{stage}-{recipe}"

    def _create(self, path: str) -> bool:
        """Linked into place: it is there whole or not at all, and never in place of another."""
        for again in (False, True):
            try:
                os.link(self._written(again), path)
            except FileExistsError:
                return False
            except FileNotFoundError:  # somebody has tidied up
                if again:
                    raise
            else:
                break
        self._taken.add(path)
        return True

    def _written(self, anew: bool) -> str:
        """The file that claims are links to."""
        if self._text is None or anew:
            self._folder.mkdir(parents=True, exist_ok=True)
            for left in self._folder.glob("*.new"):  # by killed runs
                if (holder := _holder(left)) and not alive(self.store, holder):
                    left.unlink(missing_ok=True)
            text = self._folder / f"{uuid.uuid4().hex}.new"
            text.write_text(self.lease)
            self._text = str(text)
        return self._text

    def _clear(self, path: Path) -> bool:
        """Put a killed run's claim aside; of several that try, one succeeds."""
        holder = _holder(path)
        if holder is not None and alive(self.store, holder):
            return False
        aside = path.with_name(f"{uuid.uuid4().hex}.old")
        try:
            path.rename(aside)
        except FileNotFoundError:
            return True
        if _holder(aside) != holder:  # a living run's, made in between
            with suppress(FileExistsError):
                path.hardlink_to(aside)
        aside.unlink(missing_ok=True)
        return True

    def _own(self, path: str) -> bool:
        return _holder(path) == self.lease

    def _drop(self, path: str) -> None:
        if path in self._taken:
            self._taken.discard(path)
            with suppress(OSError):
                Path(path).unlink()
            if not self._taken:
                self._forget()

    def _forget(self) -> None:
        text, self._text = self._text, None
        if text is not None:
            with suppress(OSError):
                Path(text).unlink()


def _holder(path: str | Path) -> str | None:
    try:
        return Path(path).read_text()
    except (OSError, UnicodeDecodeError):
        return None
