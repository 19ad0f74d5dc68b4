"""Words that messages, tables and pages share."""

from __future__ import annotations

import json
from typing import Any


def counted(number: int, thing: str, things: str = "") -> str:
    """1 draw, 5 draws, 2 classes; `things`: the plural, where neither s nor es makes it (vertices)."""
    plural = things or (f"{thing}es" if thing.endswith(("s", "x", "ch", "sh")) else f"{thing}s")
    return f"{number} {thing if number == 1 else plural}"


def averaged(draws: int) -> str:
    """What figures are over: one draw has no spread."""
    return f"mean ± sd over {counted(draws, 'draw')} of shots" if draws > 1 else "of 1 draw of shots"


def bare(value: Any) -> str:
    """A value as a message has it: a text as it is, anything else as JSON."""
    return value if isinstance(value, str) else json.dumps(value)
