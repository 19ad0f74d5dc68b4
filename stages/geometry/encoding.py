"""Text files as UTF-8 without a byte order mark, and names that compare alike. Standard library only: listing a data
set reads these."""

from __future__ import annotations

import codecs
import unicodedata

MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32-le"),  # before UTF-16's, which it begins with
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)


def unmarked(data: bytes) -> bytes:
    """`data` without its byte order mark, UTF-16 and UTF-32 as UTF-8 (UTF-16 also where the mark is missing)."""
    for mark, encoding in MARKS:
        if data.startswith(mark):
            rest = data[len(mark) :]
            return rest if encoding == "utf-8" else rest.decode(encoding, "replace").encode()
    even, odd = data[:64:2], data[1:64:2]
    if len(odd) >= 4 and not any(odd) and all(even):
        return data.decode("utf-16-le", "replace").encode()
    if len(odd) >= 4 and not any(even) and all(odd):
        return data.decode("utf-16-be", "replace").encode()
    return data


def alike(name: str) -> str:
    """What names have in common that differ in case, or in how accents are stored (macOS takes letters apart)."""
    return unicodedata.normalize("NFC", name).lower()


def decoded(name: bytes) -> str:
    """A file name out of a text file: UTF-8, else Windows' western code page."""
    try:
        return name.decode("utf-8")
    except UnicodeDecodeError:
        return name.decode("cp1252", "replace")
