"""How much memory a task takes at its highest, this process's own included."""

from __future__ import annotations

import contextlib
import resource
import sys
from pathlib import Path

PROC = Path("/proc/self")


def reset_peak() -> None:
    """Let what `peak_mb` tells begin anew, where the system can (Linux, and a /proc that may be written)."""
    with contextlib.suppress(OSError):
        (PROC / "clear_refs").write_text("5")


def peak_mb() -> float:
    """This process's most resident memory in MB (2²⁰ bytes) since the last `reset_peak`; where that cannot be,
    since the process began: of all of a worker's tasks so far, then."""
    try:
        line = next(line for line in (PROC / "status").read_text().splitlines() if line.startswith("VmHWM"))
        return int(line.split()[1]) / 1024
    except (OSError, StopIteration):
        unit = 2**20 if sys.platform == "darwin" else 1024  # macOS counts bytes, others kB
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit
