"""Notes: small files of our own in a store's hidden folders, written whole or not at all."""

from __future__ import annotations

import uuid
from pathlib import Path

from b23d.pipeline.errors import StoreError, reason
from b23d.pipeline.store import Store


def put_note(store: Store, name: str, data: bytes) -> None:
    """Write `<store>/<name>` in place of what was there. Raises StoreError."""
    path = f"{store.root}/{name}"
    try:
        store.fs.makedirs(path.rpartition("/")[0], exist_ok=True)
        if not store.local:
            store.fs.pipe_file(path, data)
            return
        aside = Path(f"{path}.{uuid.uuid4().hex}.new")
        try:
            aside.write_bytes(data)
            aside.replace(path)
        finally:
            aside.unlink(missing_ok=True)
    except Exception as error:
        raise StoreError(
            f"store {store.url}: expected room to write, got {reason(error)}; mend that, or give another"
        ) from error
