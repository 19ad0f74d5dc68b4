"""Whether worker processes may be started from here: each of them imports the script that is running."""

from __future__ import annotations

import re
import sys
from pathlib import Path

GUARD = re.compile(r"^if\s+__name__\s*==\s*['\"]__main__['\"]|^if\s+['\"]__main__['\"]\s*==\s*__name__", re.M)


def unguarded_script() -> str | None:
    """The running script's path, where it has no `if __name__ == "__main__":`, so that every worker process would run
    it from the top; None where there is no such danger: a module, a notebook, an interactive session, `python -c`."""
    main = sys.modules.get("__main__")
    file = getattr(main, "__file__", None)
    if file is None or getattr(main, "__spec__", None) is not None:
        return None
    try:
        text = Path(file).read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    return None if GUARD.search(text) else str(file)
