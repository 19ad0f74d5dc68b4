"""Paths of a run file: relative to the file they stand in, though a file may extend another elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from b23d.pipeline.errors import RunFileError
from b23d.schemas.runfile import StoreOptions


class Anchored(str):
    """A string of a run file that is relative to `folder`, should its field turn out to be a path."""

    folder: Path

    def __new__(cls, text: str, folder: Path) -> Anchored:
        self = super().__new__(cls, text)
        self.folder = folder
        return self


def anchor(table: dict[str, Any], folder: Path) -> None:
    """Remember of every string in a table, and in those below it, in which folder its file stands."""
    for key, value in table.items():
        if isinstance(value, dict):
            anchor(value, folder)
        elif isinstance(value, str):
            table[key] = Anchored(value, folder)


def table_in(tables: Mapping[str, Any], name: str) -> dict[str, Any]:
    """A table of that name, else an empty one: what is no table is refused when all is validated."""
    table = tables.get(name)
    return table if isinstance(table, dict) else {}


def tables_in(table: Any) -> list[Any]:
    """What stands in a table; nothing in what is none."""
    return list(table.values()) if isinstance(table, dict) else []


def place_store(tables: dict[str, Any], path: Path, where: str) -> None:
    """Make the store's root absolute: relative to the file it stands in, or to the current folder if overridden; a URL
    is left alone; `where` it is said, for messages. Raises RunFileError where it can be neither."""
    store = tables.setdefault("store", {})
    if isinstance(store, dict):
        root = store.get("root", Anchored(StoreOptions().root, path.parent))
        if isinstance(root, str):
            folder = root.folder if isinstance(root, Anchored) else Path.cwd()
            store["root"] = absolute(root, folder, where)


def absolute(root: str, folder: Path, where: str = "store") -> str:
    """A store's root as an absolute path, or the URL that it is. Raises RunFileError where it is neither."""
    if "://" in root:
        return str(root)
    try:
        return str((folder / Path(root).expanduser()).resolve())
    except (OSError, ValueError, RuntimeError) as error:  # a null byte, the home of nobody, links in a circle
        raise RunFileError(f"{where}: expected a path or a URL, got {root!r}; {error}") from error
