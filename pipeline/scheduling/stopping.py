"""Being stopped: Ctrl-C and SIGTERM end a command with one line and nothing lost; a second one ends it at once."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType


class Stopped(BaseException):  # no KeyboardInterrupt, which typer would take for itself
    """SIGINT or SIGTERM came. Its text, if any, is what to tell; `code` what to exit with."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.code = 128 + number
        self.text = "stopped; what was finished is stored, run again to go on"

    def __str__(self) -> str:
        return self.text


def stop_on_signals() -> None:
    """From now on in this process: the first signal raises Stopped, the second ends the process without a word."""

    def at_once(number: int, frame: FrameType | None) -> None:
        os._exit(128 + number)

    def stop(number: int, frame: FrameType | None) -> None:
        for each in (signal.SIGINT, signal.SIGTERM):
            signal.signal(each, at_once)
        raise Stopped(number)

    for each in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(each) is not signal.SIG_IGN:  # a shell's background job is deaf to Ctrl-C, and stays so
            signal.signal(each, stop)


def end(code: int) -> None:
    """End this process now: nothing waits for threads, and no library has a last word."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)
