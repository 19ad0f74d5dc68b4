"""Exceptions of the engine. Each keeps the built-in type it means; `B23dError` catches them all."""

from __future__ import annotations

import re
from pathlib import Path
from typing import ClassVar


class B23dError(Exception):
    """Base of the engine's own errors."""

    exit_code: ClassVar[int] = 2
    """Of the command line that ends with it."""


class RunFileError(B23dError, ValueError):
    """A run file, or an override, that does not say what it should."""


class ArtifactNotFoundError(B23dError, FileNotFoundError):
    """An artifact that is not in the store."""

    artifact: tuple[str, str] | None = None
    """(stage, address)."""


class CorruptArtifactError(B23dError, OSError):
    """An artifact in the store whose bytes are not those that were written."""

    artifact: tuple[str, str] | None = None
    """(stage, address)."""


class ResourceError(B23dError, RuntimeError):
    """A stage needs what no worker has."""


class SelectionError(B23dError, ValueError):
    """A shape, class or stage asked for that a run does not have."""


class StoreError(B23dError, OSError):
    """The store itself cannot be read or written: no space, read-only, gone. No shape's fault: a run stops at it."""

    exit_code = 3


class UnwritableStoreError(StoreError, PermissionError):
    """A store that a run could not write to, found before its first task."""


class NotAStoreError(B23dError, ValueError):
    """A folder that is no store, or one of a newer format."""


class MissingPackageError(B23dError, ImportError):
    """An optional package that is not installed; the message names the extra to install."""


class ClusterError(B23dError, ConnectionError):
    """The scheduler or the workers that a run was to use are not there, or gone."""

    exit_code = 4


class HistoryError(B23dError, LookupError):
    """A record of an execution that is not there, or that cannot be run again."""


REMEDIES: dict[type[OSError], str] = {
    FileNotFoundError: "restore it",
    PermissionError: "give it back its permissions",
}


def unreadable(path: Path, error: OSError) -> OSError:
    """The system's error about a file of a shape in our words, and of its own type. The file is called by its name
    alone: the shape's stands before it."""
    remedy = REMEDIES.get(type(error), "restore it, or try again")
    return type(error)(f"expected to read {path.name}, got {reason(error)}; {remedy}")


def reason(error: Exception) -> str:
    """What an error says, to stand after "got" where the file is named already: of a system's error its cause alone."""
    return (error.strerror if isinstance(error, OSError) else None) or str(error)


def told(error: BaseException) -> str:
    """What to say of an error that ends a command: the message, and of the system's own errors in our words."""
    if isinstance(error, KeyError) and error.args:
        return str(error.args[0])
    if isinstance(error, OSError) and error.strerror and error.filename:
        return f"{error.filename}: expected to use it, got {error.strerror}; look at it, and at its permissions"
    return str(error)


def naming(shape: str, message: str) -> str:
    """The message, with the shape's name before it unless it is in it as a word of its own: shape `1` is not named by
    "expected 1 mesh", nor `box/b1` by "box/b10" or "/data/box/b1.obj". One that is a file
    (`box/keypoints.json`) is named by the file's whole path, too."""
    named = re.search(rf"(?<![\w./\\-]){re.escape(shape)}(?![\w./\\-])", message)
    path = re.match(rf"[^:]*[/\\]{re.escape(shape.rpartition('/')[2])}: ", message)
    return message if named or path else f"{shape}: {message}"
