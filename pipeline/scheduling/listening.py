"""What libraries print and warn of while a stage runs, for the run's log."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
import tempfile
import threading
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import IO

MOST = 8192  # bytes kept of what one task says: the last ones

_ONE = threading.Lock()


@dataclass
class Said:
    text: str = ""


@contextlib.contextmanager
def listening(apart: bool) -> Iterator[Said]:
    """Within, what is printed goes nowhere else; afterwards `text` has it.

    `apart`: in a process of its own, where all that is written to stdout and stderr counts, native code's too. Else
    only Python's warnings: the rest of this process may be printing its own.
    """
    said = Said()
    if not apart:
        with warnings.catch_warnings(record=True) as caught:
            yield said
        said.text = "".join(f"{item.category.__name__}: {item.message}\n" for item in caught)[-MOST:]
    elif not _ONE.acquire(blocking=False):  # another thread's task has the process's ear
        yield said
    else:
        saved = [os.dup(number) for number in (1, 2)]
        file = _file()
        try:
            _flush()
            for number in (1, 2):
                os.dup2(file.fileno(), number)
            yield said
        finally:
            _flush()
            for number, original in zip((1, 2), saved, strict=True):
                os.dup2(original, number)
                os.close(original)
            if size := os.fstat(file.fileno()).st_size:
                text = os.pread(file.fileno(), MOST, max(0, size - MOST))
                said.text = text.decode(errors="replace")
                os.ftruncate(file.fileno(), 0)
                os.lseek(file.fileno(), 0, os.SEEK_SET)
            _ONE.release()


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(Exception):  # closed, or replaced by something that cannot
            stream.flush()
    _libc().fflush(None)


@cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None)


@cache
def _file() -> IO[bytes]:
    return tempfile.TemporaryFile()
