"""A verb of the command line: its help is shown as it is written, and what it refuses is told in our words."""

from __future__ import annotations

import re
from typing import Any

import typer
from pydantic import ValidationError
from rich.markup import escape
from typer.core import TyperCommand

from b23d.schemas.wanted import wanted


class Verb(TyperCommand):
    """Help texts are plain: `[sweep]` in one is a table of a run file, not a style to print in."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        for told in (self, *self.params):
            text = getattr(told, "help", None)
            if isinstance(text, str):
                setattr(told, "help", escape(text))  # noqa: B010  # a bare parameter has none, so mypy knows of none

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """Raises BadParameter that says what was expected of an option."""
        try:
            return super().make_context(*arguments, **options)
        except typer.BadParameter as error:
            if (words := _refused(error)) is None:
                raise
            raise typer.BadParameter(words, ctx=error.ctx, param=error.param) from error


def _refused(error: typer.BadParameter) -> str | None:
    """What was expected and what was given; None where the message is not typer's of a value."""
    if isinstance(problem := error.__cause__, ValidationError):
        first = problem.errors()[0]
        expected, got = wanted(first), first["input"]
    else:
        expected, got = str(error.message), None
    if choice := re.fullmatch(r"(['\"])(.*)\1 is not one of (.*?)\.?", expected, re.S):
        expected, got = f"one of {choice[3]}", choice[2]
    return None if got is None else f"expected {expected}, got {got!r}; mend the value"
