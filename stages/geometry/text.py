"""Numbers out of text, without a Python loop over lines: the base of the OBJ, OFF, PLY, PCD and XYZ readers."""

from __future__ import annotations

import re
import warnings

import numpy as np

from b23d.stages.geometry.surface import MalformedError

SPACE, NEWLINE, SLASH = b" "[0], b"\n"[0], b"/"[0]


def plain(data: bytes) -> bytes:
    """The text with unix line ends, blanks for tabs, no blanks at line starts, and a last line end."""
    text = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\t", b" ").replace(b"\0", b" ")
    if text.startswith(b" ") or b"\n " in text:
        text = re.sub(rb"(?m)^ +", b"", text)
    return text if text.endswith(b"\n") else text + b"\n"


def uncommented(text: bytes) -> bytes:
    """The text without what follows a `#` at a line's start or after a blank (so that Windows' `1.#QNAN` survives)."""
    return re.sub(rb"(?m)(^| )#[^\n]*", b"", text) if b"#" in text else text


def numbers(text: bytes, what: str) -> np.ndarray:
    """All numbers of a text (separated by blanks, commas or line ends) as float64; `nan` and `inf` are numbers.

    Raises MalformedError where something else stands between them; `what` names the text in the message.
    """
    text = text.replace(b",", b" ")
    if b"#" in text:
        text = re.sub(rb"-?1\.#\w+", b"nan", text)  # how Windows' C runtime prints NaN and infinity
    if not text.strip():
        return np.zeros(0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return np.fromstring(text.decode("ascii"), dtype=np.float64, sep=" ")
    except (ValueError, DeprecationWarning) as error:
        odd = next((token for token in text.split() if not _is_number(token)), b"?")
        raise MalformedError(
            f"{what}: expected numbers, got {odd[:40].decode('ascii', 'replace')!r}; export the file again"
        ) from error


def integers(values: np.ndarray, what: str) -> np.ndarray:
    """float64 numbers that are whole, as int64. Raises MalformedError where one is not."""
    wrong = ~(np.isfinite(values) & (values == np.floor(values)) & (np.abs(values) < 2**53))
    if wrong.any():
        raise MalformedError(f"{what}: expected whole numbers, got {values[wrong][0]}; export the file again")
    return values.astype(np.int64)


def tokens_per_line(text: bytes) -> np.ndarray:
    """How many blank-separated tokens each line of `text` (which ends with a line end) has: (lines,) int64."""
    buffer = np.frombuffer(text, np.uint8)
    gap = (buffer == SPACE) | (buffer == NEWLINE)
    begins = ~gap & np.concatenate([[True], gap[:-1]])
    line = np.cumsum(buffer == NEWLINE)  # the line end itself already counts to the next line, but begins no token
    return np.bincount(line[begins], minlength=text.count(b"\n"))[: text.count(b"\n")]


def corners(text: bytes, what: str) -> tuple[np.ndarray, np.ndarray]:
    """OBJ corners `v`, `v/vt`, `v//vn`, `v/vt/vn`, mixed at will: the v (c,) int64, and the vt (c,) int64, 0 where
    absent."""
    if b"/" not in text:
        first = integers(numbers(text, what), what)
        return first, np.zeros(len(first), np.int64)
    buffer = np.frombuffer(text, np.uint8)
    gap = (buffer == SPACE) | (buffer == NEWLINE)
    slash = buffer == SLASH
    slashes = np.cumsum(slash)
    field = slashes - np.maximum.accumulate(np.where(gap, slashes, 0))  # which of a token's fields a byte is in
    begins = ~gap & np.concatenate([[True], gap[:-1]])
    token = np.cumsum(begins) - 1
    first = integers(numbers(np.where(field == 0, buffer, SPACE).astype(np.uint8).tobytes(), what), what)
    second = np.zeros(len(first), np.int64)
    in_second = (field == 1) & ~slash
    has = np.unique(token[in_second])
    values = integers(numbers(np.where(in_second, buffer, SPACE).astype(np.uint8).tobytes(), what), what)
    if len(first) != begins.sum() or len(has) != len(values):
        raise MalformedError(
            f"{what}: expected corners like 1, 1/2, 1//3 or 1/2/3, got something else; export the file again"
        )
    second[has] = values
    return first, second


def _is_number(token: bytes) -> bool:
    try:
        float(token)
    except ValueError:
        return False
    return True
