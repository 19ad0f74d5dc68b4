"""A store's URL opened through fsspec; a package that a URL needs is named, with the extra that brings it."""

from __future__ import annotations

from typing import Any

import fsspec
from fsspec.implementations.local import LocalFileSystem

from b23d.pipeline.errors import MissingPackageError, NotAStoreError

EXTRAS = {
    "s3": "s3",
    "s3a": "s3",
    "gs": "gcs",
    "gcs": "gcs",
    "az": "azure",
    "abfs": "azure",
    "abfss": "azure",
    "adl": "azure",
}
"""Protocol → the extra of this package that brings what it needs."""


def open_filesystem(url: str) -> tuple[Any, str, bool]:
    """The file system, the store's root on it, and whether it is a local disk. Nothing is read or written.

    Raises MissingPackageError where the protocol's package is not installed, NotAStoreError for an unknown protocol.
    """
    protocol = url.partition("://")[0] if "://" in url else "file"
    try:
        # What others write is seen at once: object stores' file systems keep listings for good, if they may.
        options = {"auto_mkdir": True} if protocol in ("file", "local") else {"use_listings_cache": False}
        fs, root = fsspec.core.url_to_fs(url, **options)
    except ImportError as error:
        extra = EXTRAS.get(protocol)
        mend = f"pip install 'b23d[{extra}]'" if extra else "install that package"
        raise MissingPackageError(
            f"store {url}: expected the package that reads {protocol}://, got none ({error}); {mend}"
        ) from error
    except ValueError as error:
        raise NotAStoreError(
            f"store {url}: expected a path or a URL of a known protocol, got {protocol}:// ({error}); correct it"
        ) from error
    return fs, root, isinstance(fs, LocalFileSystem)
