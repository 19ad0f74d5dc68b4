"""What lies in a folder: its regular files, and by name what cannot be used. Nothing is opened.

One system call a folder and one more a symbolic link, so that 8,000 shapes are listed in a second.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path


@dataclass
class Listing:
    """Files and strangers, sorted."""

    files: dict[str, str] = field(default_factory=dict)
    """Path → place below the root, with `/`. Regular files with names in UTF-8, hidden ones left out."""
    strange: dict[str, str] = field(default_factory=dict)
    """Place below the root, printable → `expected <x>, got <y>; <what to do>`, of entries that are no such files."""
    closed: dict[str, str] = field(default_factory=dict)
    """The same of folders that cannot be entered."""

    def sorted(self) -> Listing:
        return Listing(*(dict(sorted(part.items())) for part in (self.files, self.strange, self.closed)))


def walk(root: Path) -> Listing:
    """All below `root`. Links are followed once, and never back into a folder on the way to them."""
    found = Listing()
    folders = [(str(root), "")]
    linked: set[str] = set()
    while folders:
        folder, place = folders.pop()
        for entry in _entries(folder, place, found):
            if not _is_folder(entry):
                _file(entry, place, found)
            elif _open_to_us(entry, place, linked, found):
                folders.append((entry.path, f"{place}{entry.name}/"))
    return found.sorted()


def files_of(folder: Path | str, suffix: str = "") -> Listing:
    """The files right in a folder whose names end like `suffix`, in any case, with what is strange among them. Nothing
    where there is no such folder."""
    found = Listing()
    if Path(folder).is_dir():
        for entry in _entries(str(folder), "", found):
            if entry.name.lower().endswith(suffix.lower()) and not _is_folder(entry):
                _file(entry, "", found)
    return found.sorted()


def printable(name: str) -> str:
    """The name with every byte that is not UTF-8 written as `\\xff`."""
    return name.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def hidden(name: str) -> bool:
    """Whether a name is of what systems keep for themselves: `.DS_Store`, and what macOS' archives put beside files."""
    return name.startswith(".") or name == "__MACOSX"


def encodable(name: str) -> bool:
    """Whether the name is text that every file, database and terminal takes."""
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def _entries(folder: str, place: str, found: Listing) -> list[os.DirEntry[str]]:
    try:
        with os.scandir(folder) as entries:
            return [entry for entry in entries if not hidden(entry.name)]
    except OSError as error:
        name = printable(place.rstrip("/") or folder)
        found.closed[name] = f"expected a folder that can be read, got {error.strerror}; give it back its permissions"
        return []


def _open_to_us(entry: os.DirEntry[str], place: str, linked: set[str], found: Listing) -> bool:
    """Whether to look into a folder; where it must not be entered, that is noted."""
    if not encodable(entry.name):
        found.closed[printable(place + entry.name)] = "expected a name in UTF-8, got other bytes; rename the folder"
        return False
    if not entry.is_symlink():
        return True
    target = os.path.realpath(entry.path)
    if f"{Path(entry.path).parent.resolve()}/".startswith(f"{target.rstrip('/')}/"):
        found.closed[place + entry.name] = f"expected a folder, got a link back to {target}; remove the link"
        return False
    known = target in linked
    linked.add(target)
    return not known


def _file(entry: os.DirEntry[str], place: str, found: Listing) -> None:
    name = place + entry.name
    if (reason := _reason(entry)) is not None:
        found.strange[printable(name)] = reason
    else:
        found.files[entry.path] = name


def _reason(entry: os.DirEntry[str]) -> str | None:
    """Why this is no file to open; None where it is one. A pipe or a device is never opened: reading it may hang."""
    if not encodable(entry.name):
        return "expected a name in UTF-8, got other bytes; rename the file"
    try:
        if entry.is_file():
            return None
    except OSError as error:  # a link in a circle, say
        return f"expected a file, got {error.strerror}; remove it"
    if entry.is_symlink() and not Path(entry.path).exists():
        return (
            f"expected a file, got a link to nothing ({printable(str(Path(entry.path).readlink()))}); mend or remove it"
        )
    return "expected a file, got a pipe, socket or device; remove it"


def _is_folder(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_dir()
    except OSError:
        return False
