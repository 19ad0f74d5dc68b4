"""Numbers out of text, without a Python loop over lines: the base of the OBJ, OFF, PLY, PCD, STL and XYZ readers.

`lines` is always the file's number of each line of a text, for messages.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Sequence

import numpy as np

from b23d.stages.geometry.encoding import unmarked
from b23d.stages.geometry.surface import MalformedError

SPACE, NEWLINE, SLASH = b" "[0], b"\n"[0], b"/"[0]
LineNumbers = Sequence[int] | np.ndarray
FROM_ONE = range(1, 2**60)
"""The lines of a text that is a whole file."""
PIECE = 1 << 22
"""Bytes of text whose corners are found at once: some 30 bytes of memory each."""


def plain(data: bytes) -> bytes:
    """The text in UTF-8 without byte order mark, unix line ends, blanks for tabs, none at line starts, a last line
    end."""
    text = unmarked(data).replace(b"\r\n", b"\n").replace(b"\r", b"\n").replace(b"\t", b" ").replace(b"\0", b" ")
    if text.startswith(b" ") or b"\n " in text:
        text = re.sub(rb"(?m)^ +", b"", text)
    return text if text.endswith(b"\n") else text + b"\n"


def uncommented(text: bytes) -> bytes:
    """The text without what follows a `#` at a line's start or after a blank (so that Windows' `1.#QNAN` survives)."""
    return re.sub(rb"(?m)(^| )#[^\n]*", b"", text) if b"#" in text else text


def without_commas(text: bytes, what: str, lines: LineNumbers = FROM_ONE) -> bytes:
    """The text with blanks for commas that separate numbers, and points for decimal ones.

    `1,2,3` and `1, 2, 3` separate; `0,5 1,25 2` has blanks between its numbers, so its commas are decimal. Raises
    MalformedError, with the line, where both readings are possible.
    """
    if b"," not in text:
        return text
    inside = re.search(rb"[^\s,],[^\s,]", text)
    blank = re.search(rb"[^\s,] +[^\s,]", text)
    beside = re.search(rb", +[^\s,]| ,", text)
    points = b"." in text
    alone = re.search(rb"(?<!\S)[^\s,]+,[^\s,]+,?(?!\S)", text)
    split = None if points or blank else re.search(rb",0\d", text)  # `0,05,1,25,2,00`
    if inside is None or (alone is None and split is None):  # `1, 2, 3`; `1,2,3 255 0 0`
        return text.replace(b",", b" ")
    inside = split if alone is None else inside
    if blank is None and beside is None and (points or not (inside := re.search(rb",0\d", text))):
        return text.replace(b",", b" ")  # `1,2,3`
    if blank is None and beside is not None and points:
        return text.replace(b",", b" ")  # `1.5,2.5, 3`
    if blank is not None and beside is None and not points and not re.search(rb",[^\s,]*,", text):
        return text.replace(b",", b".")
    assert inside is not None
    where = inside.start()
    line = text[text.rfind(b"\n", 0, where) + 1 : text.find(b"\n", where)].strip()
    raise MalformedError(
        f"{_at(text, where, lines)}{what}: expected numbers with decimal points, got {_quoted(line)}, whose commas may "
        "be decimal or separate; write it with points"
    )


def numbers(text: bytes, what: str, lines: LineNumbers = FROM_ONE) -> np.ndarray:
    """All numbers of a text (separated by blanks, commas or line ends) as float64; `nan` and `inf` are numbers.

    Raises MalformedError where something else stands between them; `what` names the text in the message.
    """
    text = without_commas(text, what, lines)
    if b"#" in text:
        text = re.sub(rb"-?1\.#\w+", b"nan", text)  # how Windows' C runtime prints NaN and infinity
    if not text.strip():
        return np.zeros(0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            return np.fromstring(text.decode("ascii"), dtype=np.float64, sep=" ")
    except (ValueError, DeprecationWarning) as error:
        odd = next((token for token in re.finditer(rb"\S+", text) if not _is_number(token[0])), None)
        where, got = ("", "something else") if odd is None else (_at(text, odd.start(), lines), _quoted(odd[0]))
        raise MalformedError(f"{where}{what}: expected numbers, got {got}; export the file again") from error


def integers(values: np.ndarray, what: str) -> np.ndarray:
    """float64 numbers that are whole, as int64. Raises MalformedError where one is not."""
    wrong = ~(np.isfinite(values) & (values == np.floor(values)) & (np.abs(values) < 2**53))
    if wrong.any():
        raise MalformedError(f"{what}: expected whole numbers, got {values[wrong][0]}; export the file again")
    return values.astype(np.int64)


def tokens_per_line(text: bytes) -> np.ndarray:
    """How many blank-separated tokens each line of `text` (which ends with a line end) has: (lines,) int64."""
    if not text:
        return np.zeros(0, np.int64)
    buffer = np.frombuffer(text, np.uint8)
    ends = np.flatnonzero(buffer == NEWLINE)
    return np.add.reduceat(_begins(buffer), np.concatenate([[0], ends[:-1] + 1]), dtype=np.int64)


def corners(text: bytes, what: str, lines: LineNumbers = FROM_ONE) -> tuple[np.ndarray, np.ndarray]:
    """OBJ corners `v`, `v/vt`, `v//vn`, `v/vt/vn`, mixed at will: the v (c,) int64, and the vt (c,) int64, 0 where
    absent."""
    if b"/" not in text:
        first = integers(numbers(text, what, lines), what)
        return first, np.zeros(len(first), np.int64)
    found = [_slashed_corners(piece, what, lines[line:]) for line, piece in _pieces(text)]
    return np.concatenate([first for first, _ in found]), np.concatenate([second for _, second in found])


def _slashed_corners(text: bytes, what: str, lines: LineNumbers) -> tuple[np.ndarray, np.ndarray]:
    buffer = np.frombuffer(text, np.uint8)
    gap = (buffer == SPACE) | (buffer == NEWLINE)
    slash = buffer == SLASH
    slashes = np.cumsum(slash)
    field = slashes - np.maximum.accumulate(np.where(gap, slashes, 0))  # which of a token's fields a byte is in
    begins = _begins(buffer)
    token = np.cumsum(begins) - 1

    def read(chosen: np.ndarray) -> np.ndarray:
        kept = np.where(chosen | (buffer == NEWLINE), buffer, SPACE).astype(np.uint8)
        return integers(numbers(kept.tobytes(), what, lines), what)

    in_second = (field == 1) & ~slash & ~gap
    first, values, has = read(field == 0), read(in_second), np.unique(token[in_second])
    if len(first) != begins.sum() or len(has) != len(values):
        raise MalformedError(
            f"{what}: expected corners like 1, 1/2, 1//3 or 1/2/3, got something else; export the file again"
        )
    second = np.zeros(len(first), np.int64)
    second[has] = values
    return first, second


def _begins(buffer: np.ndarray) -> np.ndarray:
    """Which bytes begin a token: (n,) bool."""
    gap = (buffer == SPACE) | (buffer == NEWLINE)
    return ~gap & np.concatenate([[True], gap[:-1]])


def _pieces(text: bytes) -> Iterator[tuple[int, bytes]]:
    """Runs of whole lines of about `PIECE` bytes, and how many lines are before each."""
    start = line = 0
    while start < len(text):
        stop = text.find(b"\n", start + PIECE) + 1 or len(text)
        piece = text[start:stop]
        yield line, piece
        start, line = stop, line + piece.count(b"\n")


def _at(text: bytes, place: int, lines: LineNumbers) -> str:
    before = text.count(b"\n", 0, place)
    return f"line {lines[before]}: "


def _quoted(token: bytes) -> str:
    return repr(token[:40].decode("utf-8", "replace"))


def _is_number(token: bytes) -> bool:
    try:
        float(token)
    except ValueError:
        return False
    return b"_" not in token
