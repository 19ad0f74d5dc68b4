"""The end of a message about a name, or a glob, that is not known."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase


def hint(name: str, known: Sequence[str], otherwise: str = "") -> str:
    """The nearest known name; of `<class>/<id>`, in the class that is meant. otherwise: what to say where none is near;
    by default an example."""
    if (close := _nearest(str(name), known)) is not None:
        return f"did you mean {close!r}?"
    return otherwise or (f"for example {known[0]!r}" if known else "there are none")


def _nearest(name: str, known: Sequence[str]) -> str | None:
    category, slash, of_class = name.partition("/")
    if not slash:
        ids = {one.rpartition("/")[2]: one for one in reversed(known)}
        within = [one for one in known if name in one] if name else []
        found = _like(name, known) or _like(name, ids) or next(iter(within), None)
        return ids.get(found, found) if found is not None and found not in known else found
    classes = list(dict.fromkeys(one.partition("/")[0] for one in known if "/" in one))
    meant = category if category in classes else _like(category, classes)
    if meant is None:
        return _like(name, known)
    if any(fnmatchcase(one, f"{meant}/{of_class}") for one in known):
        return f"{meant}/{of_class}"
    ids = {one.partition("/")[2]: one for one in known if one.startswith(f"{meant}/")}
    return ids[_like(of_class, ids) or next(iter(ids))]


def _like(name: str, known: Iterable[str]) -> str | None:
    """The closest of these, whatever the case; a glob is like what its letters are like."""
    lower = {one.lower(): one for one in known}
    found = difflib.get_close_matches(name.lower().strip("*?"), lower, 1)
    return lower[found[0]] if found else None
