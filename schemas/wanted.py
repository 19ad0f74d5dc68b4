"""What pydantic found wrong with a value, in our words: what was expected."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

KINDS = {
    "int": "a whole number",
    "float": "a number",
    "finite_number": "a finite number",
    "bool": "true or false",
    "string": "text",
    "list": "a list",
    "tuple": "a list",
    "dict": "a table",
    "path": "a path",
}
"""Beginning of a problem's type → what it wants."""
LIMITS = {
    "greater_than_equal": "{ge} or more",
    "greater_than": "more than {gt}",
    "less_than_equal": "{le} or less",
    "less_than": "less than {lt}",
    "string_pattern_mismatch": "text like {pattern}",
    "string_too_short": "text of {min_length} characters or more",
    "string_too_long": "text of {max_length} characters or less",
    "too_short": "{min_length} or more of them",
    "too_long": "{max_length} of them or less",
    "literal_error": "one of {expected}",
}
"""Type of a problem → what it wants, of what pydantic says with it."""


def wanted(problem: Mapping[str, Any]) -> str:
    """What was expected, to stand behind "expected": `a whole number`, `1 or more`, `one of 'a', 'b'`.

    problem: one of a ValidationError's errors.
    """
    kind, context = problem["type"], problem.get("ctx", {})
    if kind in LIMITS:
        said = LIMITS[kind].format(**context)
        return re.sub(r"' or '", "', '", said) if kind == "literal_error" else said
    if kind == "value_error":
        return str(context["error"])
    first = next((words for name, words in KINDS.items() if kind.startswith(name)), None)
    said = re.sub(r"^(Value error, |Assertion failed, |Input should be (a valid )?)", "", problem["msg"])
    return first or f"{said[:1].lower()}{said[1:]}"
