"""Markers: how a folder says that it is a store. `b23d-store.json`, with the version of the store's format.

Stores from before there were markers are known by their layout, and get a marker when something is next written to
them. Whatever else lies in a store's folder is nobody's business: it is neither read nor removed.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any

from b23d.pipeline.errors import NotAStoreError, StoreError, reason

MARKER = "b23d-store.json"
FORMAT = 1
"""Raised when a store is written that older programs would misread."""

STAGE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
FAN = re.compile(r"[0-9a-f]{2}")
REST = re.compile(r"[0-9a-f]{62}")


def store_format(fs: Any, root: str) -> int | None:
    """The format that the marker names; None where there is no marker, or none that can be read."""
    try:
        told = json.loads(fs.cat_file(f"{root}/{MARKER}"))
        return int(told["format"])
    except Exception:  # object stores raise what they like
        return None


def check_format(fs: Any, root: str, url: str) -> None:
    """Raises NotAStoreError where the store is of a newer format than this program knows."""
    found = store_format(fs, root)
    if found is not None and found > FORMAT:
        raise NotAStoreError(
            f"store {url}: expected format {FORMAT} or older, got {found}; "
            "it was written by a newer b23d: upgrade, or give another store with --store"
        )


def mark(fs: Any, root: str) -> None:
    """Write the marker where there is none. Raises OSError where nothing can be written."""
    if store_format(fs, root) is None:
        fs.pipe_file(f"{root}/{MARKER}", json.dumps({"what": "a store of b23d", "format": FORMAT}).encode())


def stages_in(fs: Any, root: str, head: str) -> Iterator[str]:
    """Stages that have artifacts: `<stage>/<2 hex>/<62 hex>/<head>` is there."""
    for stage in names(fs, root):
        if STAGE.fullmatch(stage) and any(
            fs.exists(f"{root}/{stage}/{fan}/{rest}/{head}")
            for fan in names(fs, f"{root}/{stage}")
            if FAN.fullmatch(fan)
            for rest in names(fs, f"{root}/{stage}/{fan}")
            if REST.fullmatch(rest)
        ):
            yield stage


def names(fs: Any, folder: str) -> list[str]:
    """Names in a folder; none where it is not there, or is no folder. Raises StoreError where it cannot be listed."""
    try:
        found = [str(child).rstrip("/") for child in fs.ls(folder, detail=False)]
    except (FileNotFoundError, NotADirectoryError, PermissionError):
        return []
    except Exception as error:  # object stores raise what they like
        raise StoreError(
            f"store: expected to list {folder}, got {reason(error)}; mend that, or give another"
        ) from error
    return sorted(path.rsplit("/", 1)[-1] for path in found if path != folder.rstrip("/"))
